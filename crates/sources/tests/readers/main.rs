//! Reader tests with real files, files written by the tests, and damaged files.

#![allow(
    clippy::cast_possible_truncation,
    clippy::cast_possible_wrap,
    clippy::cast_sign_loss,
    reason = "tests use small numbers"
)]
#![allow(clippy::unwrap_used, reason = "tests fail loudly")]

mod attribute_files;
mod dicom_files;
mod dicom_support;
mod grid_support;
mod hdf5_files;
mod metaimage_files;
mod metaimage_fuzz;
mod nifti_files;
mod nifti_fuzz;
mod npy_files;
mod npy_fuzz;
mod npz_files;
mod nrrd_files;
mod nrrd_fuzz;
mod other_formats;
mod pictures_files;
mod pictures_fuzz;
mod raw_files;
mod segy_files;
mod segy_fuzz;
mod segy_surveys;
mod segy_synthetic;
mod several_volumes;
mod synthetic_fields;
mod tiff_compressed;
mod tiff_files;
mod tiff_kinds;
mod vtk_files;
mod vtk_fuzz;
mod zarr_files;

#[global_allocator]
static RECORDING: grid_support::largest_allocation::Recording = grid_support::largest_allocation::Recording;
