//! Readers: one module per file format.
//!
//! A reader turns files of one format into a [`VolumeSource`](crate::VolumeSource). [`crate::open`] finds the reader
//! for a file.

pub mod bigdataviewer;
pub mod dicom;
pub mod hdf5;
pub mod metaimage;
pub mod nifti;
pub mod npy;
pub mod npz;
pub mod nrrd;
pub mod pictures;
pub mod raw;
pub mod segy;
pub mod tiff;
pub(crate) mod unsupported;
pub mod vtk;
pub mod zarr;
