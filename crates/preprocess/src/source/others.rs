//! Formats that are not read: known by what their files begin with, by their names, or by what a folder holds, so that a person
//! hears which format it is and what converts it.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use super::SourceError;

/// A format, and what makes of it something that is read.
struct Other {
    name: &'static str,
    way_out: &'static str,
}

/// Bytes of a file that are looked at.
pub(super) const HEAD_BYTES: u64 = 512;
/// Entries of a folder that are looked at.
const ENTRIES_LIMIT: usize = 64;
/// Files of a folder that are looked into.
const FILES_LOOKED_AT: usize = 8;

const CONTAINER: Other = Other {
    name: "a container of Supervol",
    way_out: "it is a built volume already: give it to `supervol render`, `info`, `verify` or `extract`",
};
const DICOM: Other = Other {
    name: "DICOM",
    way_out: "convert the series, for example with `dcm2niix -z y -o OUT FOLDER` or SimpleITK's `ImageSeriesReader`",
};
const TIFF: Other = Other {
    name: "TIFF files, one of which is a volume where it has several pages",
    way_out: "give one such file, or stack single pages first, for example with Fiji (Import, Image Sequence)",
};
const PICTURE: Other = Other {
    name: "one picture",
    way_out: "stack pictures into a volume first, for example with Fiji (Import, Image Sequence; Save As, NRRD)",
};
const HDF5: Other = Other {
    name: "HDF5 (also NetCDF 4, Imaris, MINC 2, BigDataViewer)",
    way_out: "write one dataset out, for example with Python: `numpy.save(OUT, h5py.File(IN)[DATASET][:])`",
};
const ZARR: Other = Other {
    name: "Zarr or OME-Zarr",
    way_out: "write one array out, for example with Python: `numpy.save(OUT, zarr.open(IN)[\"0\"][:])`",
};
const N5: Other =
    Other { name: "N5", way_out: "write one dataset out, for example with Fiji (Import, N5; Save As, NRRD)" };
const NPZ: Other = Other {
    name: "a ZIP archive (also .npz)",
    way_out: "unpack it first: `unzip IN`; the arrays of an .npz are .npy files, which are read",
};
const VTK_XML: Other =
    Other { name: "a VTK XML file", way_out: "convert it with ParaView (Save Data, MetaImage or NRRD)" };
const VTK_LEGACY: Other =
    Other { name: "a legacy VTK file", way_out: "convert it with ParaView (Save Data, MetaImage or NRRD)" };
const NETCDF: Other = Other {
    name: "NetCDF 3 (also MINC 1)",
    way_out: "convert it: `ncks`, or Python: `numpy.save(OUT, xarray.open_dataset(IN)[NAME].values)`; MINC with `mnc2nii`",
};
const MRC: Other = Other {
    name: "MRC or CCP4",
    way_out: "convert it with Python: `numpy.save(OUT, mrcfile.open(IN).data)`, or IMOD's `mrc2tif`",
};
const AMIRA: Other =
    Other { name: "an AmiraMesh", way_out: "export it from Amira or Fiji as NRRD or raw (with --dims and --dtype)" };
const OPEN_VDB: Other =
    Other { name: "OpenVDB", way_out: "sample the grid into an array (pyopenvdb's `copyToArray`) and save it as .npy" };
const MICROSCOPE: Other = Other {
    name: "a microscope's own format",
    way_out: "convert it with Bio-Formats (`bfconvert IN OUT.ome.tif`) or Fiji",
};
const SEISMIC_STORE: Other = Other {
    name: "a seismic store (ZGY or OpenVDS)",
    way_out: "export it as SEG-Y, for example with `zgycopy` or OpenVDS' `VDSCopy`",
};
const SEISMIC_UNIX: Other =
    Other { name: "Seismic Unix", way_out: "write it as SEG-Y: `segyhdrs < IN.su | segywrite tape=OUT.sgy`" };
const ANALYSE_IMAGES: Other =
    Other { name: "FreeSurfer's MGH or MGZ", way_out: "convert it: `mri_convert IN OUT.nii.gz`" };
const COMPRESSED: Other =
    Other { name: "a compressed file", way_out: "unpack it first (gunzip, bunzip2, unxz, zstd -d)" };
const MATLAB: Other = Other {
    name: "MATLAB",
    way_out: "save the array with `niftiwrite`, or with Python: `numpy.save(OUT, scipy.io.loadmat(IN)[NAME])`",
};

/// What files begin with: place, bytes, format.
const STARTS: [(usize, &[u8], &Other); 23] = [
    (0, &supervol_format::container::header::MAGIC, &CONTAINER),
    (128, b"DICM", &DICOM),
    (0, b"\x89PNG", &PICTURE),
    (0, b"\xff\xd8\xff", &PICTURE),
    (0, b"\0\0\0\x0cjP  ", &PICTURE),
    (0, b"\x76\x2f\x31\x01", &PICTURE),
    (0, b"\x89HDF\r\n\x1a\n", &HDF5),
    (0, b"PK\x03\x04", &NPZ),
    (0, b"# vtk DataFile", &VTK_LEGACY),
    (0, b"<VTKFile", &VTK_XML),
    (0, b"<?xml version=\"1.0\"?>\n<VTKFile", &VTK_XML),
    (0, b"CDF\x01", &NETCDF),
    (0, b"CDF\x02", &NETCDF),
    (208, b"MAP ", &MRC),
    (0, b"# AmiraMesh", &AMIRA),
    (0, b"# Avizo", &AMIRA),
    (0, b" BDV\0\0\0\0", &OPEN_VDB),
    (0, b"ZISRAWFILE", &MICROSCOPE),
    (0, b"\xda\xce\xbe\x0a", &MICROSCOPE),
    (0, b"VBS\0", &SEISMIC_STORE),
    (0, b"VDS\0", &SEISMIC_STORE),
    (0, b"\x1f\x8b", &COMPRESSED),
    (0, b"MATLAB 5.0", &MATLAB),
];

/// What files are called, where their first bytes do not say.
const NAMES: [(&[&str], &Other); 11] = [
    (&[".dcm", ".dicom", ".ima"], &DICOM),
    (&[".png", ".jpg", ".jpeg", ".bmp", ".jp2", ".exr"], &PICTURE),
    (&[".h5", ".hdf5", ".ims", ".nc", ".mnc"], &HDF5),
    (&[".npz", ".zip"], &NPZ),
    (&[".vti", ".vtp", ".vtu", ".vtr", ".vts"], &VTK_XML),
    (&[".mrc", ".map", ".rec", ".ccp4"], &MRC),
    (&[".czi", ".nd2", ".lif", ".oib", ".oif", ".lsm", ".vsi"], &MICROSCOPE),
    (&[".zgy", ".vds"], &SEISMIC_STORE),
    (&[".su"], &SEISMIC_UNIX),
    (&[".mgh", ".mgz"], &ANALYSE_IMAGES),
    (&[".gz", ".bz2", ".xz", ".zst", ".7z", ".tar"], &COMPRESSED),
];

/// Files that make a folder what it is, exactly or by their ends.
const FOLDERS: [(&[&str], &Other); 6] = [
    (&[".zarray", ".zgroup", ".zattrs", "zarr.json"], &ZARR),
    (&["attributes.json"], &N5),
    (&["DICOMDIR", ".dcm", ".dicom", ".ima"], &DICOM),
    (&[".tif", ".tiff"], &TIFF),
    (&[".png", ".jpg", ".jpeg", ".bmp"], &PICTURE),
    (&["layout.bin", "volumedatalayout"], &SEISMIC_STORE),
];

fn refused(path: &Path, other: &Other) -> SourceError {
    SourceError::unsupported(path, format!("this is {}, which is not read", other.name), other.way_out)
}

/// The refusal of a file of another format, by its first bytes or its name (in lower case); `None` where neither is known.
pub(super) fn refusal_of_file(path: &Path, head: &[u8], name: &str) -> Option<SourceError> {
    let begins =
        |&&(at, bytes, _): &&(usize, &[u8], &Other)| head.get(at..).is_some_and(|head| head.starts_with(bytes));
    let by_start = STARTS.iter().find(begins).map(|(.., other)| *other);
    let by_name = || NAMES.iter().find(|(ends, _)| ends.iter().any(|end| name.ends_with(end))).map(|(_, other)| *other);
    by_start.or_else(by_name).map(|other| refused(path, other))
}

/// Whether a file has the mark of DICOM; nothing that is no file is opened.
fn is_dicom(path: &Path) -> bool {
    let mut head = [0; 132];
    let mut read = || File::open(path).and_then(|mut file| file.read_exact(&mut head));
    path.is_file() && read().is_ok() && head.ends_with(b"DICM")
}

/// The refusal of a folder, by what lies in it; `None` where that is nothing we know, or it is none.
pub(super) fn refusal_of_folder(path: &Path) -> Option<SourceError> {
    let entries = std::fs::read_dir(path).ok()?;
    let names: Vec<String> =
        entries.flatten().take(ENTRIES_LIMIT).map(|e| e.file_name().to_string_lossy().into_owned()).collect();
    let holds = |(ends, _): &&(&[&str], &Other)| {
        names.iter().any(|name| ends.iter().any(|end| name == end || name.to_lowercase().ends_with(end)))
    };
    let other = match FOLDERS.iter().find(holds) {
        Some((_, other)) => other,
        // Files of DICOM often have no ending.
        None => names.iter().take(FILES_LOOKED_AT).any(|name| is_dicom(&path.join(name))).then_some(&DICOM)?,
    };
    let what = format!("this is a folder of {}, which is not read", other.name);
    Some(SourceError::unsupported(path, what, other.way_out))
}
