//! Small valid files, one for each fuzzed reader.

/// SEG-Y: 4 x 3 traces of 5 samples, 16-bit integers, big endian.
#[must_use]
pub fn segy_seed() -> Vec<u8> {
    let mut file = vec![0x40; 3200];
    file[0] = 0xc3;
    let mut binary = vec![0u8; 400];
    binary[16..18].copy_from_slice(&4000u16.to_be_bytes());
    binary[20..22].copy_from_slice(&5u16.to_be_bytes());
    binary[24..26].copy_from_slice(&3u16.to_be_bytes());
    binary[300..302].copy_from_slice(&[1, 0]);
    binary[302..304].copy_from_slice(&1u16.to_be_bytes());
    file.extend(binary);
    for (inline, crossline) in (0..3u32).flat_map(|i| (0..4u32).map(move |x| (100 + i, 200 + x))) {
        let mut header = vec![0u8; 240];
        header[28..30].copy_from_slice(&1u16.to_be_bytes());
        header[114..116].copy_from_slice(&5u16.to_be_bytes());
        header[116..118].copy_from_slice(&4000u16.to_be_bytes());
        header[188..192].copy_from_slice(&inline.to_be_bytes());
        header[192..196].copy_from_slice(&crossline.to_be_bytes());
        file.extend(header);
        file.extend((0..5u32).flat_map(|k| ((inline * crossline + k * 37) as i16).to_be_bytes()));
    }
    file
}

/// NRRD: 4 x 3 x 2 voxels of i16 with all common fields.
#[must_use]
pub fn nrrd_seed() -> Vec<u8> {
    let mut file = b"NRRD0004\ntype: short\ndimension: 3\nspace: left-posterior-superior\nsizes: 4 3 2\n\
        space directions: (1,0,0) (0,2.5,0) (0,0,-1)\nkinds: domain domain domain\nendian: little\nencoding: raw\n\
        space origin: (0,1e3,0)\n\n"
        .to_vec();
    file.extend(0..48u8);
    file
}

/// MetaImage: 4 x 3 x 2 voxels of i16 with all common fields.
#[must_use]
pub fn metaimage_seed() -> Vec<u8> {
    let mut file = b"ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = False\n\
        CompressedData = False\nTransformMatrix = 1 0 0 0 0 1 0 -1 0\nOffset = 1 -2 1e3\nElementSpacing = 1 2.5 1\n\
        DimSize = 4 3 2\nHeaderSize = 0\nElementType = MET_SHORT\nElementDataFile = LOCAL\n"
        .to_vec();
    file.extend(0..48u8);
    file
}

/// NIfTI: 4 x 3 x 2 voxels of i16 with an sform.
#[must_use]
pub fn nifti_seed() -> Vec<u8> {
    let mut file = vec![0; 352 + 48];
    let mut put = |at: usize, bytes: &[u8]| file[at..at + bytes.len()].copy_from_slice(bytes);
    put(0, &348i32.to_le_bytes());
    for (i, n) in [3i16, 4, 3, 2, 1, 1, 1, 1].into_iter().enumerate() {
        put(40 + 2 * i, &n.to_le_bytes());
    }
    put(70, &4i16.to_le_bytes());
    put(72, &16i16.to_le_bytes());
    (1..4).for_each(|axis| put(76 + 4 * axis, &2.0f32.to_le_bytes()));
    put(108, &352.0f32.to_le_bytes());
    put(252, &[1, 0, 1, 0]);
    (0..3).for_each(|i| put(280 + 20 * i, &2.0f32.to_le_bytes()));
    put(344, b"n+1\0");
    file
}

/// ANALYZE 7.5: header of the same voxels.
#[must_use]
pub fn analyze_seed() -> Vec<u8> {
    let mut header = nifti_seed();
    header.truncate(348);
    for (at, bytes) in [(108, 4), (252, 4), (344, 4)] {
        header[at..at + bytes].fill(0);
    }
    header[112..116].copy_from_slice(&0.5f32.to_le_bytes());
    header
}

/// npy: 2 x 3 x 4 voxels of f32, C order.
#[must_use]
pub fn npy_seed() -> Vec<u8> {
    let mut dictionary = b"{'descr': '<f4', 'fortran_order': False, 'shape': (2, 3, 4), }".to_vec();
    dictionary.resize(117, b' ');
    dictionary.push(b'\n');
    let mut file = b"\x93NUMPY\x01\x00".to_vec();
    file.extend((dictionary.len() as u16).to_le_bytes());
    file.extend(dictionary);
    file.extend((0..24).flat_map(|i| (i as f32).to_le_bytes()));
    file
}

/// A DICOM element in explicit little endian.
fn element(tag: u32, kind: &[u8; 2], value: &[u8]) -> Vec<u8> {
    let mut value = value.to_vec();
    if value.len() % 2 == 1 {
        value.push(if kind == b"UI" { 0 } else { b' ' });
    }
    let tag = [((tag >> 16) as u16).to_le_bytes(), (tag as u16).to_le_bytes()].concat();
    let is_long = [b"OB", b"OW", b"SQ"].contains(&kind);
    let length = match is_long {
        true => [&[0; 2], &(value.len() as u32).to_le_bytes()[..]].concat(),
        false => (value.len() as u16).to_le_bytes().to_vec(),
    };
    [&tag, &kind[..], &length, &value].concat()
}

/// A DICOM tag with a length and no value: items and delimiters.
fn bare(tag: u32, length: u32) -> Vec<u8> {
    [&((tag >> 16) as u16).to_le_bytes()[..], &(tag as u16).to_le_bytes(), &length.to_le_bytes()].concat()
}

fn sequence(tag: u32, items: &[Vec<u8>]) -> Vec<u8> {
    let items: Vec<u8> =
        items.iter().flat_map(|item| [bare(0xfffe_e000, item.len() as u32), item.clone()].concat()).collect();
    element(tag, b"SQ", &items)
}

fn dicom_file(syntax: &[u8], elements: &[Vec<u8>]) -> Vec<u8> {
    let group = element(0x0002_0010, b"UI", syntax);
    let length = element(0x0002_0000, b"UL", &(group.len() as u32).to_le_bytes());
    [vec![0; 128], b"DICM".to_vec(), length, group, elements.concat()].concat()
}

fn image(frames: &[u8]) -> Vec<Vec<u8>> {
    let word = |tag, value: u16| element(tag, b"US", &value.to_le_bytes());
    vec![
        word(0x0028_0002, 1),
        element(0x0028_0004, b"CS", b"MONOCHROME2"),
        element(0x0028_0008, b"IS", frames),
        word(0x0028_0010, 3),
        word(0x0028_0011, 4),
        element(0x0028_0030, b"DS", b"0.5\\0.25"),
        word(0x0028_0100, 16),
        word(0x0028_0101, 12),
        word(0x0028_0102, 11),
        word(0x0028_0103, 1),
    ]
}

/// DICOM: 4 x 3 voxels of 12 bits, with a position and a rescale slope.
#[must_use]
pub fn dicom_seed() -> Vec<u8> {
    let mut elements = vec![
        element(0x0008_0060, b"CS", b"CT"),
        element(0x0018_0050, b"DS", b"2.5"),
        element(0x0020_000e, b"UI", b"1.2.3"),
        element(0x0020_0032, b"DS", b"1\\-2\\3e1"),
        element(0x0020_0037, b"DS", b"1\\0\\0\\0\\1\\0"),
    ];
    elements.extend(image(b"1"));
    elements.push(element(0x0028_1052, b"DS", b"-1024"));
    elements.push(element(0x0028_1053, b"DS", b"1"));
    elements.push(element(0x7fe0_0010, b"OW", &(0..24).collect::<Vec<u8>>()));
    dicom_file(b"1.2.840.10008.1.2.1", &elements)
}

/// DICOM: 4 x 3 x 2 voxels; each slice is a frame with its own position and RLE compression.
#[must_use]
pub fn dicom_frames_seed() -> Vec<u8> {
    let place = |z: &[u8]| sequence(0x0020_9113, &[element(0x0020_0032, b"DS", &[b"1\\-2\\", z].concat())]);
    let shared = sequence(0x0020_9116, &[element(0x0020_0037, b"DS", b"1\\0\\0\\0\\1\\0")]);
    let mut header = [0; 64];
    [2u32, 64, 66]
        .iter()
        .enumerate()
        .for_each(|(i, word)| header[4 * i..4 * i + 4].copy_from_slice(&word.to_le_bytes()));
    // Twelve equal high bytes, twelve different low bytes.
    let frame = [&header[..], &[245, 1], &[11], &(0..12).collect::<Vec<u8>>(), &[0]].concat();
    let mut elements = vec![element(0x0008_0060, b"CS", b"MR"), element(0x0020_000e, b"UI", b"1.2.3")];
    elements.extend(image(b"2"));
    elements.push(sequence(0x5200_9229, &[shared]));
    elements.push(sequence(0x5200_9230, &[place(b"0"), place(b"2.5")]));
    let open = [&0x7fe0u16.to_le_bytes()[..], &0x10u16.to_le_bytes(), b"OB\0\0", &u32::MAX.to_le_bytes()].concat();
    elements.extend([open, bare(0xfffe_e000, 0)]);
    elements.extend([
        bare(0xfffe_e000, frame.len() as u32),
        frame.clone(),
        bare(0xfffe_e000, frame.len() as u32),
        frame,
    ]);
    elements.push(bare(0xfffe_e0dd, 0));
    dicom_file(b"1.2.840.10008.1.2.5", &elements)
}

/// TIFF: [`tiff_seed`], pages with JPEG (with and without tables shared by strips), and with zstd
/// (with predictors, planar).
#[must_use]
pub fn tiff_seeds() -> Vec<Vec<u8>> {
    let stored: [&[u8]; 5] = [
        include_bytes!("../data/tiff/jpeg-tables-grey.tif"),
        include_bytes!("../data/tiff/jpeg-ycbcr-strips.tif"),
        include_bytes!("../data/tiff/zstd-u16-big-endian-predictor.tif"),
        include_bytes!("../data/tiff/zstd-f32-predictor.tif"),
        include_bytes!("../data/tiff/zstd-planes.tif"),
    ];
    std::iter::once(tiff_seed()).chain(stored.map(<[u8]>::to_vec)).collect()
}

/// TIFF: 4 x 3 x 2 voxels of u16 in two pages, with a description of ImageJ.
#[must_use]
pub fn tiff_seed() -> Vec<u8> {
    let text = b"ImageJ=1.54f\nimages=2\nslices=2\nunit=mm\nspacing=2.5\n\0";
    let mut file = b"II*\0".to_vec();
    let data_at = 8 + text.len() as u32;
    file.extend((data_at + 48).to_le_bytes());
    file.extend(text);
    file.extend(0..48u8);
    for page in 0..2u32 {
        let begin = file.len() as u32;
        let mut fields: Vec<[u32; 4]> = vec![
            [256, 4, 1, 4],
            [257, 4, 1, 3],
            [258, 3, 1, 16],
            [259, 3, 1, 1],
            [262, 3, 1, 1],
            [273, 4, 1, data_at + 24 * page],
            [277, 3, 1, 1],
            [278, 4, 1, 3],
            [279, 4, 1, 24],
        ];
        if page == 0 {
            fields.insert(5, [270, 2, text.len() as u32, 8]);
        }
        file.extend((fields.len() as u16).to_le_bytes());
        for [tag, kind, count, value] in &fields {
            file.extend((*tag as u16).to_le_bytes());
            file.extend((*kind as u16).to_le_bytes());
            file.extend(count.to_le_bytes());
            file.extend(value.to_le_bytes());
        }
        let next = begin + 2 + 12 * fields.len() as u32 + 4;
        file.extend(if page == 0 { next } else { 0 }.to_le_bytes());
    }
    file
}

/// VTK XML: 4 x 3 x 2 voxels of i16 as text, as base64, and raw behind the XML.
#[must_use]
pub fn vti_seed() -> Vec<u8> {
    let text = "<?xml version=\"1.0\"?>\n<VTKFile type=\"ImageData\" version=\"1.0\" byte_order=\"LittleEndian\" header_type=\"UInt32\">\n\
        <ImageData WholeExtent=\"0 3 0 2 0 1\" Origin=\"1 -2 1e3\" Spacing=\"1 2.5 1\" Direction=\"1 0 0 0 0 1 0 -1 0\">\n\
        <Piece Extent=\"0 3 0 2 0 1\">\n<PointData Scalars=\"a\">\n\
        <DataArray type=\"Int16\" Name=\"a\" format=\"appended\" offset=\"0\"/>\n\
        <DataArray type=\"Int16\" Name=\"b\" format=\"ascii\">1 2 3 4 5 6 7 8 9 10 11 12 13 14 15 16 17 18 19 20 21 22 23 24</DataArray>\n\
        </PointData>\n<CellData><DataArray type=\"UInt8\" Name=\"c\" format=\"binary\">BgAAAAECAwQFBg==</DataArray></CellData>\n\
        </Piece></ImageData>\n<AppendedData encoding=\"raw\">_";
    [text.as_bytes(), &48u32.to_le_bytes(), &(0..48).collect::<Vec<u8>>(), b"</AppendedData></VTKFile>"].concat()
}

/// VTK XML: [`vti_seed`], and an image with LZ4-compressed arrays.
#[must_use]
pub fn vti_seeds() -> Vec<Vec<u8>> {
    vec![vti_seed(), include_bytes!("../data/vtk/appended-lz4-32-le.vti").to_vec()]
}

/// Legacy VTK: 4 x 3 x 2 voxels of i16, big endian, with a colour table and a second array.
#[must_use]
pub fn vtk_seed() -> Vec<u8> {
    let text =
        b"# vtk DataFile Version 3.0\nseed\nBINARY\nDATASET STRUCTURED_POINTS\nDIMENSIONS 4 3 2\nSPACING 1 2.5 1\n\
        ORIGIN 1 -2 1e3\nPOINT_DATA 24\nSCALARS a short 1\nLOOKUP_TABLE default\n";
    [&text[..], &(0..48).collect::<Vec<u8>>(), b"\nFIELD FieldData 1\nb 1 24 unsigned_char\n", &[7; 24]].concat()
}

/// Blosc: 8 x 4 x 2 voxels of u16, shuffled, one block, with literals and a match of `BloscLZ`.
fn blosc_seed() -> Vec<u8> {
    let stream = [&[31][..], &(0..32).collect::<Vec<u8>>(), &[0xe0, 87, 31]].concat();
    let sizes = [128u32, 128, 16 + 4 + 4 + stream.len() as u32, 20, stream.len() as u32].map(u32::to_le_bytes);
    [&[2, 1, 0x11, 2], sizes.as_flattened(), &stream].concat()
}

/// Zarr 2: metadata of an array, a zero byte, its chunk.
#[must_use]
pub fn zarr_seed() -> Vec<u8> {
    let text = r#"{"zarr_format":2,"shape":[2,4,8],"chunks":[2,4,8],"dtype":"<u2","compressor":{"id":"blosc"},"filters":null,
        "fill_value":0,"order":"C"}"#;
    [text.as_bytes(), &[0], &blosc_seed()].concat()
}

/// Zarr 3: metadata, a zero byte, and a shard of two chunks, one of them present.
#[must_use]
pub fn zarr3_seed() -> Vec<u8> {
    let text = r#"{"zarr_format":3,"node_type":"array","shape":[4,4,8],"data_type":"uint16","fill_value":"0x0001","chunk_grid":
        {"name":"regular","configuration":{"chunk_shape":[4,4,8]}},"chunk_key_encoding":{"name":"default"},"codecs":[{"name":
        "sharding_indexed","configuration":{"chunk_shape":[2,4,8],"codecs":["bytes",{"name":"blosc"}],"index_codecs":["bytes"]}}]}"#;
    let chunk = blosc_seed();
    let index = [0, chunk.len() as u64, u64::MAX, u64::MAX].map(u64::to_le_bytes);
    [text.as_bytes(), &[0], &chunk, index.as_flattened()].concat()
}

/// N5: metadata, a zero byte, and a block smaller than the block size.
#[must_use]
pub fn n5_seed() -> Vec<u8> {
    let text = r#"{"dimensions":[8,4,2],"blockSize":[8,4,4],"dataType":"uint16","compression":{"type":"blosc"}}"#;
    let header = [0, 0, 0, 3, 0, 0, 0, 8, 0, 0, 0, 4, 0, 0, 0, 2];
    [text.as_bytes(), &[0], &header, &blosc_seed()].concat()
}

/// HDF5: 8 x 4 x 2 voxels of u16 in two chunks, as h5py writes them.
#[must_use]
pub fn hdf5_seed() -> Vec<u8> {
    include_bytes!("../data/hdf5/seed.h5").to_vec()
}
