//! Unsupported formats, recognized by first bytes, file name or the contents of a folder. The error names the format
//! and a conversion.

use std::path::Path;

use crate::input::start::FileStart;
use crate::{Message, ReadOption, SourceError};

/// Placeholder for the file's own name in a conversion.
const INPUT: &str = "{in}";

/// An unsupported format, and how to convert it to a supported one.
struct Other {
    name: &'static str,
    way_out: &'static str,
    as_raw: AsRaw,
}

/// Whether the voxels of an unsupported format can be read as raw. Options for that follow the way out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum AsRaw {
    /// The way out is complete.
    No,
    /// With dims and voxel type.
    WithShape,
    /// With dims and voxel type, behind a header of so many bytes that states both.
    BehindHeader(u64),
}

/// First bytes of an ENVI header; its file name may end like NIfTI's.
pub(crate) const ENVI_START: &[u8] = b"ENVI";
/// Entries of a folder that are examined.
const ENTRIES_LIMIT: usize = 64;

const CONTAINER: Other = Other {
    name: "a container of Supervol",
    way_out: "it is a built volume already: give it to `supervol render`, `info`, `verify` or `extract`",
    as_raw: AsRaw::No,
};
const PICTURE: Other = Other {
    name: "a picture of a kind that holds no slices",
    way_out: "convert it to PNG or TIFF first, for example with `magick {in} OUT.png`",
    as_raw: AsRaw::No,
};
const ZIP: Other = Other {
    name: "a ZIP archive",
    way_out: "unpack it first: `unzip {in}`; read are archives of Zarr or N5, and those of NumPy arrays that are called .npz",
    as_raw: AsRaw::No,
};
const VTK_MESH: Other = Other {
    name: "a VTK file of meshes or of grids with uneven distances",
    way_out: "resample it to an image first, for example with ParaView (Resample To Image; Save Data, .vti)",
    as_raw: AsRaw::No,
};
const NETCDF: Other = Other {
    name: "NetCDF 3 (also MINC 1)",
    way_out: "convert it to NetCDF 4: `nccopy -k nc4 {in} OUT.nc`; MINC with `mnc2nii {in} OUT.nii`",
    as_raw: AsRaw::No,
};
const MRC: Other = Other {
    name: "MRC or CCP4",
    way_out: "convert it with Python: `numpy.save(OUT, mrcfile.open('{in}').data)`, or IMOD's `mrc2tif`",
    as_raw: AsRaw::No,
};
const AMIRA: Other = Other {
    name: "an AmiraMesh",
    way_out: "export it from Amira or Fiji as NRRD, or as raw with ",
    as_raw: AsRaw::WithShape,
};
const OPEN_VDB: Other = Other {
    name: "OpenVDB",
    way_out: "sample the grid into an array (pyopenvdb's `copyToArray`) and save it as .npy",
    as_raw: AsRaw::No,
};
const MICROSCOPE: Other = Other {
    name: "a microscope's own format",
    way_out: "convert it with Bio-Formats (`bfconvert {in} OUT.ome.tif`) or Fiji",
    as_raw: AsRaw::No,
};
const SEISMIC_STORE: Other = Other {
    name: "a seismic store (ZGY or OpenVDS)",
    way_out: "export it as SEG-Y, for example with `zgycopy` or OpenVDS' `VDSCopy`",
    as_raw: AsRaw::No,
};
const SEISMIC_UNIX: Other = Other {
    name: "Seismic Unix",
    way_out: "write it as SEG-Y: `segyhdrs < {in} | segywrite tape=OUT.sgy`",
    as_raw: AsRaw::No,
};
const ANALYSE_IMAGES: Other =
    Other { name: "FreeSurfer's MGH or MGZ", way_out: "convert it: `mri_convert {in} OUT.nii.gz`", as_raw: AsRaw::No };
const COMPRESSED: Other =
    Other { name: "a compressed file", way_out: "unpack it first (gunzip, bunzip2, unxz, zstd -d)", as_raw: AsRaw::No };
const ARCHIVE: Other = Other {
    name: "an archive of files",
    way_out: "unpack it first, for example with `tar xf {in}`",
    as_raw: AsRaw::No,
};
const FITS: Other = Other {
    name: "FITS",
    way_out: "convert it with Python: `numpy.save(OUT, astropy.io.fits.getdata('{in}'))`",
    as_raw: AsRaw::No,
};
const XDMF: Other = Other {
    name: "XDMF",
    way_out: "give the HDF5 file that it names (FILE.h5:/PATH), or save it as .vti with ParaView (Save Data)",
    as_raw: AsRaw::No,
};
const ENVI: Other = Other {
    name: "the header of an ENVI image",
    way_out: "convert it: `gdal_translate {in} OUT.tif`, or build its data as raw, with ",
    as_raw: AsRaw::WithShape,
};
const INRIMAGE: Other = Other { name: "an INRIMAGE", way_out: "build it as raw: ", as_raw: AsRaw::BehindHeader(256) };
const PHILIPS: Other = Other {
    name: "Philips' PAR and REC",
    way_out: "convert it with `dcm2niix`, or nibabel's `parrec2nii {in}`",
    as_raw: AsRaw::No,
};
const PVM: Other = Other {
    name: "a PVM volume",
    way_out: "convert it with `pvm2raw` (V3), and build that with ",
    as_raw: AsRaw::WithShape,
};
const MATLAB: Other = Other {
    name: "MATLAB",
    way_out: "save the array with `niftiwrite`, or with Python: `numpy.save(OUT, scipy.io.loadmat('{in}')[NAME])`",
    as_raw: AsRaw::No,
};

/// First bytes of files: offset, bytes, format.
const STARTS: &[(usize, &[u8], &Other)] = &[
    (0, &supervol_format::container::header::MAGIC, &CONTAINER),
    (0, b"\0\0\0\x0cjP  ", &PICTURE),
    (0, b"\x76\x2f\x31\x01", &PICTURE),
    (0, b"PK\x03\x04", &ZIP),
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
    (0, b"SIMPLE  =", &FITS),
    (0, ENVI_START, &ENVI),
    (0, b"#INRIMAGE-4#{", &INRIMAGE),
    (0, b"# === DATA DESCRIPTION FILE", &PHILIPS),
    (0, b"PVM\n", &PVM),
    (0, b"PVM2\n", &PVM),
    (0, b"PVM3\n", &PVM),
    (0, b"DDS v3d\n", &PVM),
    (0, b"OLYMPUSRAWFORMAT", &MICROSCOPE),
];

/// File name endings, for files whose first bytes do not tell.
const NAMES: &[(&[&str], &Other)] = &[
    (&[".bmp", ".jp2", ".exr", ".webp", ".gif"], &PICTURE),
    (&[".nc", ".mnc"], &NETCDF),
    (&[".vtp", ".vtu", ".vtr", ".vts"], &VTK_MESH),
    (&[".zip"], &ZIP),
    (&[".mrc", ".map", ".rec", ".ccp4"], &MRC),
    (&[".czi", ".nd2", ".lif", ".oib", ".oif", ".lsm", ".vsi"], &MICROSCOPE),
    (&[".zgy", ".vds"], &SEISMIC_STORE),
    (&[".su"], &SEISMIC_UNIX),
    (&[".mgh", ".mgz"], &ANALYSE_IMAGES),
    (&[".fits", ".fit", ".fts"], &FITS),
    (&[".xdmf", ".xmf"], &XDMF),
    (&[".par"], &PHILIPS),
    (&[".tar", ".tar.gz", ".tgz", ".tar.xz", ".tar.bz2", ".tar.zst"], &ARCHIVE),
    (&[".gz", ".bz2", ".xz", ".zst", ".7z"], &COMPRESSED),
];

/// Files that identify a folder, by their name or its end.
const FOLDERS: &[(&[&str], &Other)] = &[(&["layout.bin", "volumedatalayout"], &SEISMIC_STORE)];

fn refused(path: &Path, what: &str, other: &Other) -> SourceError {
    let way_out = Message::from(other.way_out.replace(INPUT, &path.display().to_string()));
    let with_shape = |message: Message| message.option(ReadOption::Dims).text(" and ").option(ReadOption::VoxelType);
    let advice = match other.as_raw {
        AsRaw::No => way_out,
        AsRaw::WithShape => with_shape(way_out),
        AsRaw::BehindHeader(bytes) => {
            let header = way_out.option(ReadOption::HeaderBytes).text(format_args!(" {bytes}, with "));
            with_shape(header).text(" from its header")
        }
    };
    SourceError::unsupported(path, format!("this is {what}{}, which is not read", other.name), advice)
}

/// Error for a ZIP archive without supported contents.
pub(crate) fn refusal_of_zip(path: &Path, what: &str) -> SourceError {
    SourceError::unsupported(path, what, format!("unpack it first: `unzip {}`", path.display()))
}

/// Error for a file of another format, from its first bytes or its name; `None` if neither is known.
pub(crate) fn refusal_of_file(start: &FileStart<'_>) -> Option<SourceError> {
    let FileStart { path, bytes: head, name } = start;
    let begins =
        |&&(at, bytes, _): &&(usize, &[u8], &Other)| head.get(at..).is_some_and(|head| head.starts_with(bytes));
    let by_start = STARTS.iter().find(begins).map(|(.., other)| *other);
    let by_name = NAMES.iter().find(|(ends, _)| ends.iter().any(|end| name.ends_with(end))).map(|(_, other)| *other);
    // For a compressed file the name tells more than the first bytes.
    let by_start = by_start.filter(|other| !std::ptr::eq(*other, &COMPRESSED) || by_name.is_none());
    by_start.or(by_name).map(|other| refused(path, "", other))
}

/// Error for a folder, from its contents; `None` if they are unknown, or the path is not a folder.
pub(crate) fn refusal_of_folder(path: &Path) -> Option<SourceError> {
    let entries = std::fs::read_dir(path).ok()?;
    let names: Vec<String> =
        entries.flatten().take(ENTRIES_LIMIT).map(|e| e.file_name().to_string_lossy().into_owned()).collect();
    let holds = |(ends, _): &&(&[&str], &Other)| {
        names.iter().any(|name| ends.iter().any(|end| name == end || name.to_lowercase().ends_with(end)))
    };
    let (_, other) = FOLDERS.iter().find(holds)?;
    Some(refused(path, "a folder of ", other))
}
