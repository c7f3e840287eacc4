//! Readers: one module per file format, and the table of all formats.
//!
//! A reader turns files of one format into a [`VolumeSource`](crate::VolumeSource). Its module exports a `FORMAT`: a row of
//! [`FORMATS`] with its name, the function that recognizes a file and the one that opens it. [`crate::open`] takes the first row
//! that recognizes a file. Another reader needs its module and one line of the table.

pub mod bigdataviewer;
pub mod dicom;
pub mod format;
pub mod hdf5;
pub mod metaimage;
pub mod nifti;
pub mod npy;
pub mod npz;
pub mod nrrd;
pub mod options;
pub mod pictures;
pub mod raw;
pub mod segy;
pub mod tiff;
pub(crate) mod unsupported;
pub mod vtk;
pub mod zarr;

use self::format::Format;

/// All formats that are read, in order of priority: the first that recognizes a file or a folder opens it.
pub const FORMATS: &[Format] = &[
    raw::FORMAT,
    zarr::FORMAT,
    // Before TIFF: the preamble of DICOM has room for a TIFF's beginning, and some programs write one.
    dicom::FORMAT,
    vtk::FORMAT,
    bigdataviewer::FORMAT,
    npz::FORMAT,
    hdf5::FORMAT,
    nrrd::FORMAT,
    metaimage::FORMAT,
    npy::FORMAT,
    nifti::FORMAT,
    tiff::FORMAT,
    pictures::FORMAT,
    // Near the end: any text may begin as a SEG-Y does.
    segy::FORMAT,
    zarr::ARCHIVE,
];
