//! Readers: one module per file format, and the table of all formats.
//!
//! A reader turns files of one format into a [`VolumeSource`](crate::VolumeSource). Its module exports `FORMAT`, a row
//! of [`FORMATS`]: the name of the format, a function that recognizes files, and a function that opens them.
//! [`mod@crate::open`] takes the first row that recognizes a file. A new reader needs its module and a
//! row in its place; the checklist in CONTRIBUTING.md names all other places.

pub(crate) mod array_survey;
pub mod bigdataviewer;
pub(crate) mod cf;
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

/// Names of the formats for lists in help texts and messages, in the order of the table.
pub fn titles() -> impl Iterator<Item = &'static str> {
    FORMATS.iter().map(|format| format.title).filter(|title| !title.is_empty())
}

/// Ends of file names of all formats, in the order of the table.
pub fn endings() -> impl Iterator<Item = &'static str> {
    FORMATS.iter().flat_map(|format| format.endings.iter().copied())
}

/// Table of all formats, in order of priority: the first row that recognizes a file or a folder opens it.
pub const FORMATS: &[Format] = &[
    raw::FORMAT,
    zarr::FORMAT,
    // DICOM comes before TIFF: some programs write the first bytes of a TIFF into the preamble of a DICOM file.
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
    // SEG-Y comes late: any text may begin as a SEG-Y does.
    segy::FORMAT,
    zarr::ARCHIVE,
];
