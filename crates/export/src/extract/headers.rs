//! Bytes before and behind the voxels of a plain file: npy, NRRD, NIfTI, MetaImage, TIFF, VTK.
//!
//! All formats but raw and npy state the placement of the volume: [`Place`]. NIfTI's world is right-anterior-superior,
//! MetaImage's left-posterior-superior. For a patient volume in the other space, x and y are reversed, so that each
//! voxel keeps its place in the patient. TIFF states only spacing and unit (as OME-XML). All numbers are little endian.

use supervol_format::cast::narrow;
use supervol_format::space::WorldSpace;
use supervol_format::{Geometry, VoxelType};

/// Largest number of slices of a TIFF, which has a directory per slice; our reader has the same limit.
pub(super) const TIFF_SLICES_LIMIT: usize = 1 << 16;
/// Bytes of a BigTIFF's header, and of an entry of its directories.
const BIG_TIFF_HEADER_BYTES: u64 = 16;
const BIG_TIFF_ENTRY_BYTES: u64 = 20;
/// Bytes before the voxels of a NIfTI-1 and a NIfTI-2 file: the header, and the mark that no extension follows.
const NIFTI_OFFSETS: [usize; 2] = [352, 544];
/// Greatest size of an axis in NIfTI-1.
const NIFTI_1_AXIS_LIMIT: usize = i16::MAX as usize;

/// Formats of plain files.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Format {
    Npy,
    Raw,
    Nrrd,
    Nifti,
    MetaImage,
    Tiff,
    Vti,
    Zarr,
    Segy,
}

impl Format {
    /// The format of a file name's ending, and whether the file is compressed.
    pub(super) fn of_name(name: &str) -> Option<(Self, bool)> {
        const ENDS: [(&str, Format, bool); 12] = [
            (".npy", Format::Npy, false),
            (".raw", Format::Raw, false),
            (".nrrd", Format::Nrrd, false),
            (".nii", Format::Nifti, false),
            (".nii.gz", Format::Nifti, true),
            (".mha", Format::MetaImage, false),
            (".tif", Format::Tiff, false),
            (".tiff", Format::Tiff, false),
            (".vti", Format::Vti, false),
            (".zarr", Format::Zarr, false),
            (".sgy", Format::Segy, false),
            (".segy", Format::Segy, false),
        ];
        let name = name.to_ascii_lowercase();
        ENDS.iter().find(|(end, ..)| name.ends_with(end)).map(|&(_, format, is_compressed)| (format, is_compressed))
    }
}

/// Properties of the voxels for a header.
pub(super) struct Place<'a> {
    pub(super) voxel_type: VoxelType,
    /// Number of voxels along x, y, z.
    pub(super) sizes: [usize; 3],
    pub(super) geometry: Geometry,
    pub(super) space: WorldSpace,
    /// Unit of the spacing; empty if unknown.
    pub(super) unit: &'a str,
}

impl Place<'_> {
    /// Bytes before the voxels.
    pub(super) fn header(&self, format: Format) -> Vec<u8> {
        match format {
            // These have writers of their own, or no header.
            Format::Raw | Format::Zarr | Format::Segy => Vec::new(),
            Format::Npy => self.npy(),
            Format::Nrrd => self.nrrd().into_bytes(),
            Format::Nifti => self.nifti(),
            Format::MetaImage => self.metaimage().into_bytes(),
            Format::Tiff => self.tiff_header(),
            Format::Vti => self.vti(),
        }
    }

    /// Bytes behind the voxels.
    pub(super) fn trailer(&self, format: Format) -> Vec<u8> {
        match format {
            Format::Tiff => self.tiff_directories(),
            Format::Vti => b"\n  </AppendedData>\n</VTKFile>\n".to_vec(),
            _ => Vec::new(),
        }
    }

    fn bytes(&self) -> u64 {
        self.sizes.iter().map(|&n| n as u64).product::<u64>() * self.voxel_type.bytes() as u64
    }

    /// The geometry in a patient space; x and y are reversed if the volume is in the other patient space.
    fn geometry_in(&self, space: WorldSpace) -> Geometry {
        let mut geometry = self.geometry;
        if self.space != WorldSpace::Unknown && self.space != space {
            for row in 0..2 {
                // Adding 0 turns -0 into 0.
                geometry.origin[row] = -geometry.origin[row] + 0.0;
                geometry.direction[3 * row..3 * row + 3].iter_mut().for_each(|v| *v = -*v + 0.0);
            }
        }
        geometry
    }

    /// NPY format 1.0 (NEP 1): magic, version, header length, a Python dictionary padded to 64 bytes.
    fn npy(&self) -> Vec<u8> {
        let descr = numpy_name(self.voxel_type);
        let [nx, ny, nz] = self.sizes;
        let mut dictionary = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': ({nz}, {ny}, {nx}), }}");
        let padding = 64 - (10 + dictionary.len() + 1) % 64;
        dictionary.push_str(&" ".repeat(padding % 64));
        dictionary.push('\n');
        let mut header = b"\x93NUMPY\x01\x00".to_vec();
        let dictionary_bytes = u16::try_from(dictionary.len()).expect("a dictionary with three sizes is short");
        header.extend(dictionary_bytes.to_le_bytes());
        header.extend(dictionary.into_bytes());
        header
    }

    fn nrrd(&self) -> String {
        let kind = match self.voxel_type {
            VoxelType::U8 => "uint8",
            VoxelType::I8 => "int8",
            VoxelType::U16 => "uint16",
            VoxelType::I16 => "int16",
            VoxelType::U32 => "uint32",
            VoxelType::I32 => "int32",
            VoxelType::F32 => "float",
            VoxelType::F64 => "double",
        };
        let Geometry { spacing, origin, direction: d } = &self.geometry;
        let vector = |v: [f64; 3]| format!("({},{},{})", v[0], v[1], v[2]);
        // A space direction is a column of D times the spacing.
        let directions: Vec<String> =
            (0..3).map(|a| vector([d[a], d[3 + a], d[6 + a]].map(|c| c * spacing[a]))).collect();
        let space = match self.space.name() {
            "" => "space dimension: 3".into(),
            name => format!("space: {name}"),
        };
        let endian = if self.voxel_type.bytes() > 1 { "endian: little\n" } else { "" };
        let units = match self.unit {
            "" => String::new(),
            unit => format!("space units: \"{unit}\" \"{unit}\" \"{unit}\"\n"),
        };
        let [x, y, z] = self.sizes;
        format!(
            "NRRD0004\ntype: {kind}\ndimension: 3\n{space}\nsizes: {x} {y} {z}\nspace directions: {}\nspace origin: {}\n\
             {units}{endian}encoding: raw\n\n",
            directions.join(" "),
            vector(*origin)
        )
    }

    /// NIfTI-1, or NIfTI-2 if an axis is too long for it. The placement is the sform.
    fn nifti(&self) -> Vec<u8> {
        let code: i16 = match self.voxel_type {
            VoxelType::U8 => 2,
            VoxelType::I16 => 4,
            VoxelType::I32 => 8,
            VoxelType::F32 => 16,
            VoxelType::F64 => 64,
            VoxelType::I8 => 256,
            VoxelType::U16 => 512,
            VoxelType::U32 => 768,
        };
        let bits = i16::try_from(8 * self.voxel_type.bytes()).expect("a voxel has at most 64 bits");
        let units: u8 = match self.unit {
            "m" => 1,
            "mm" => 2,
            "um" => 3,
            _ => 0,
        };
        // 1: scanner coordinates; 2: aligned to another data set.
        let sform_code: i16 = if self.space == WorldSpace::Unknown { 2 } else { 1 };
        let geometry = self.geometry_in(WorldSpace::RightAnteriorSuperior);
        let linear = geometry.linear().transpose().to_cols_array();
        let row = |row: usize, i: usize| if i < 3 { linear[3 * row + i] } else { geometry.origin[row] };
        let dims: [usize; 8] =
            std::array::from_fn(|i| if i == 0 { 3 } else { self.sizes.get(i - 1).copied().unwrap_or(1) });
        let is_long = self.sizes.iter().any(|n| *n > NIFTI_1_AXIS_LIMIT);
        let offset = NIFTI_OFFSETS[usize::from(is_long)];
        let mut header = vec![0; offset];
        let mut put = |at: usize, bytes: &[u8]| header[at..at + bytes.len()].copy_from_slice(bytes);
        if is_long {
            put(0, &540i32.to_le_bytes());
            put(4, b"n+2\0\r\n\x1a\n");
            put(12, &code.to_le_bytes());
            put(14, &bits.to_le_bytes());
            dims.iter().enumerate().for_each(|(i, n)| put(16 + 8 * i, &narrow::<i64>(*n).to_le_bytes()));
            geometry.spacing.iter().enumerate().for_each(|(i, s)| put(112 + 8 * i, &s.to_le_bytes()));
            put(168, &narrow::<i64>(offset).to_le_bytes());
            put(176, &1f64.to_le_bytes());
            put(348, &i32::from(sform_code).to_le_bytes());
            (0..12).for_each(|i| put(400 + 8 * i, &row(i / 4, i % 4).to_le_bytes()));
            put(500, &i32::from(units).to_le_bytes());
        } else {
            put(0, &348i32.to_le_bytes());
            let dims = dims.map(|n| i16::try_from(n).expect("no axis is longer than NIfTI-1 allows"));
            dims.iter().enumerate().for_each(|(i, n)| put(40 + 2 * i, &n.to_le_bytes()));
            put(70, &code.to_le_bytes());
            put(72, &bits.to_le_bytes());
            geometry.spacing.iter().enumerate().for_each(|(i, s)| put(80 + 4 * i, &single(*s)));
            put(108, &(offset as f32).to_le_bytes());
            put(112, &1f32.to_le_bytes());
            put(123, &[units]);
            put(254, &sform_code.to_le_bytes());
            (0..12).for_each(|i| put(280 + 4 * i, &single(row(i / 4, i % 4))));
            put(344, b"n+1\0");
        }
        header
    }

    fn metaimage(&self) -> String {
        let kind = match self.voxel_type {
            VoxelType::U8 => "MET_UCHAR",
            VoxelType::I8 => "MET_CHAR",
            VoxelType::U16 => "MET_USHORT",
            VoxelType::I16 => "MET_SHORT",
            VoxelType::U32 => "MET_UINT",
            VoxelType::I32 => "MET_INT",
            VoxelType::F32 => "MET_FLOAT",
            VoxelType::F64 => "MET_DOUBLE",
        };
        let Geometry { spacing, origin, direction: d } = self.geometry_in(WorldSpace::LeftPosteriorSuperior);
        let words = |numbers: &[f64]| numbers.iter().map(f64::to_string).collect::<Vec<_>>().join(" ");
        // Each row of the matrix is an axis of the grid.
        let matrix = [d[0], d[3], d[6], d[1], d[4], d[7], d[2], d[5], d[8]];
        let orientation = match self.space {
            WorldSpace::Unknown => "???".into(),
            _ => anatomical(&matrix),
        };
        // ITK declares this space for every image. The comment tells our reader that it really holds.
        let comment = match self.space {
            WorldSpace::Unknown => String::new(),
            _ => format!("Comment = {}\n", WorldSpace::LeftPosteriorSuperior.name()),
        };
        let unit = if self.unit.is_empty() { String::new() } else { format!("DistanceUnits = {}\n", self.unit) };
        let [x, y, z] = self.sizes;
        format!(
            "ObjectType = Image\nNDims = 3\n{comment}BinaryData = True\nBinaryDataByteOrderMSB = False\nCompressedData = False\n\
             TransformMatrix = {}\nOffset = {}\nCenterOfRotation = 0 0 0\nAnatomicalOrientation = {orientation}\n{unit}\
             ElementSpacing = {}\nDimSize = {x} {y} {z}\nElementType = {kind}\nElementDataFile = LOCAL\n",
            words(&matrix),
            words(&origin),
            words(&spacing)
        )
    }

    /// BigTIFF, with eight bytes per offset. The directories are behind the voxels.
    fn tiff_header(&self) -> Vec<u8> {
        let first_directory = BIG_TIFF_HEADER_BYTES + self.bytes();
        [&b"II\x2b\0\x08\0\0\0"[..], &(first_directory + padded(self.ome_xml()).len() as u64).to_le_bytes()].concat()
    }

    /// OME-XML, which states exact voxel sizes, with the zero byte that ends it.
    fn ome_xml(&self) -> Vec<u8> {
        let kind = match self.voxel_type {
            VoxelType::U8 => "uint8",
            VoxelType::I8 => "int8",
            VoxelType::U16 => "uint16",
            VoxelType::I16 => "int16",
            VoxelType::U32 => "uint32",
            VoxelType::I32 => "int32",
            VoxelType::F32 => "float",
            VoxelType::F64 => "double",
        };
        let [nx, ny, nz] = self.sizes;
        let known = ["m", "mm", "nm", "km", "ft"].contains(&self.unit);
        // OME's default unit is the micrometre; `reference frame` means no unit.
        let unit = match self.unit {
            "um" => "\u{b5}m",
            unit if known => unit,
            _ => "reference frame",
        };
        let sizes: Vec<String> = ["X", "Y", "Z"]
            .iter()
            .zip(self.geometry.spacing)
            .map(|(axis, spacing)| format!("PhysicalSize{axis}=\"{spacing}\" PhysicalSize{axis}Unit=\"{unit}\""))
            .collect();
        let text = format!(
            "<?xml version=\"1.0\" encoding=\"UTF-8\"?><OME xmlns=\"http://www.openmicroscopy.org/Schemas/OME/2016-06\">\
             <Image ID=\"Image:0\"><Pixels ID=\"Pixels:0\" DimensionOrder=\"XYZCT\" Type=\"{kind}\" BigEndian=\"false\" \
             SizeX=\"{nx}\" SizeY=\"{ny}\" SizeZ=\"{nz}\" SizeC=\"1\" SizeT=\"1\" {}><Channel ID=\"Channel:0:0\" \
             SamplesPerPixel=\"1\"/><TiffData IFD=\"0\" PlaneCount=\"{nz}\"/></Pixels></Image></OME>",
            sizes.join(" ")
        );
        let mut text = text.into_bytes();
        text.push(0);
        text
    }

    /// The description, and a directory for each slice, whose pixels are one strip.
    fn tiff_directories(&self) -> Vec<u8> {
        let format = match self.voxel_type {
            VoxelType::U8 | VoxelType::U16 | VoxelType::U32 => 1,
            VoxelType::I8 | VoxelType::I16 | VoxelType::I32 => 2,
            VoxelType::F32 | VoxelType::F64 => 3,
        };
        let [width, height, slices] = self.sizes.map(|n| n as u64);
        let strip_bytes = width * height * self.voxel_type.bytes() as u64;
        let description = self.ome_xml();
        let (description_at, text_bytes) = (BIG_TIFF_HEADER_BYTES + self.bytes(), description.len() as u64);
        let mut out = padded(description);
        let mut at = description_at + out.len() as u64;
        const SHORT: u16 = 3;
        const LONG8: u16 = 16;
        for slice in 0..slices {
            let mut entries = vec![
                (256u16, LONG8, 1, width),
                (257, LONG8, 1, height),
                (258, SHORT, 1, 8 * self.voxel_type.bytes() as u64),
                (259, SHORT, 1, 1),
                (262, SHORT, 1, 1),
                (273, LONG8, 1, BIG_TIFF_HEADER_BYTES + slice * strip_bytes),
                (277, SHORT, 1, 1),
                (278, LONG8, 1, height),
                (279, LONG8, 1, strip_bytes),
                (339, SHORT, 1, format),
            ];
            if slice == 0 {
                entries.insert(5, (270, 2, text_bytes, description_at));
            }
            at += 8 + BIG_TIFF_ENTRY_BYTES * entries.len() as u64 + 8;
            out.extend((entries.len() as u64).to_le_bytes());
            for (tag, kind, count, value) in entries {
                out.extend(tag.to_le_bytes());
                out.extend(kind.to_le_bytes());
                out.extend(count.to_le_bytes());
                out.extend(value.to_le_bytes());
            }
            let next = if slice + 1 < slices { at } else { 0 };
            out.extend(next.to_le_bytes());
        }
        out
    }

    fn vti(&self) -> Vec<u8> {
        let kind = match self.voxel_type {
            VoxelType::U8 => "UInt8",
            VoxelType::I8 => "Int8",
            VoxelType::U16 => "UInt16",
            VoxelType::I16 => "Int16",
            VoxelType::U32 => "UInt32",
            VoxelType::I32 => "Int32",
            VoxelType::F32 => "Float32",
            VoxelType::F64 => "Float64",
        };
        let Geometry { spacing, origin, direction } = &self.geometry;
        let words = |numbers: &[f64]| numbers.iter().map(f64::to_string).collect::<Vec<_>>().join(" ");
        let extent = self.sizes.map(|n| format!("0 {}", n - 1)).join(" ");
        let text = format!(
            "<?xml version=\"1.0\"?>\n<VTKFile type=\"ImageData\" version=\"1.0\" byte_order=\"LittleEndian\" \
             header_type=\"UInt64\">\n  <ImageData WholeExtent=\"{extent}\" Origin=\"{}\" Spacing=\"{}\" \
             Direction=\"{}\">\n    <Piece Extent=\"{extent}\">\n      <PointData Scalars=\"values\">\n        \
             <DataArray type=\"{kind}\" Name=\"values\" format=\"appended\" offset=\"0\"/>\n      </PointData>\n    \
             </Piece>\n  </ImageData>\n  <AppendedData encoding=\"raw\">\n   _",
            words(origin),
            words(spacing),
            words(direction)
        );
        [text.as_bytes(), &self.bytes().to_le_bytes()].concat()
    }
}

/// A description up to the directories, which begin at even bytes.
fn padded(mut description: Vec<u8>) -> Vec<u8> {
    description.resize(description.len().next_multiple_of(2), 0);
    description
}

/// Patient side at which each axis of the grid begins, in ITK's spelling. The matrix has an axis in each row, in
/// left-posterior-superior.
fn anatomical(matrix: &[f64; 9]) -> String {
    let letter = |axis: &[f64]| {
        let world = (0..3).max_by(|a, b| axis[*a].abs().total_cmp(&axis[*b].abs())).unwrap_or_default();
        let [from, to] = [["R", "L"], ["A", "P"], ["I", "S"]][world];
        if axis[world] < 0.0 { to } else { from }
    };
    matrix.chunks(3).map(letter).collect()
}

/// Name of a type in NumPy and Zarr, little endian (`numpy.lib.format`).
pub(super) fn numpy_name(voxel_type: VoxelType) -> &'static str {
    match voxel_type {
        VoxelType::U8 => "|u1",
        VoxelType::I8 => "|i1",
        VoxelType::U16 => "<u2",
        VoxelType::I16 => "<i2",
        VoxelType::U32 => "<u4",
        VoxelType::I32 => "<i4",
        VoxelType::F32 => "<f4",
        VoxelType::F64 => "<f8",
    }
}

/// Bytes of a number in single precision, in which NIfTI-1 states the placement.
#[expect(clippy::cast_possible_truncation, reason = "rounding to single precision is wanted")]
fn single(number: f64) -> [u8; 4] {
    (number as f32).to_le_bytes()
}
