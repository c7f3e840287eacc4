//! Other TIFFs than grey stacks: 64-bit integers, single bits, separate planes, OME series.

use std::path::{Path, PathBuf};

use supervol_format::{Dims, VoxelType};
use supervol_sources::open::{OpenOptions, open};
use supervol_sources::{SourceError, VolumeSource};

use crate::grid_support;
use grid_support::*;

const WHITE_IS_ZERO: u16 = 0;
const BLACK_IS_ZERO: u16 = 1;
const RGB: u16 = 2;
const WHOLE: u16 = 1;
const SIGNED: u16 = 2;

/// A page of a classic TIFF, uncompressed.
#[derive(Clone)]
struct Page {
    size: [u32; 2],
    bits: u16,
    samples: u16,
    format: u16,
    photometric: u16,
    /// Size of the tiles; `None` for strips.
    tile: Option<[u32; 2]>,
    /// Rows per strip.
    rows: u32,
    chunks: Vec<Vec<u8>>,
    /// Fields of text: tag and value.
    texts: &'static [(u16, &'static str)],
}

impl Page {
    fn grey(size: [u32; 2], bits: u16, format: u16, bytes: &[u8]) -> Self {
        let chunks = vec![bytes.to_vec()];
        Self {
            size,
            bits,
            samples: 1,
            format,
            photometric: BLACK_IS_ZERO,
            tile: None,
            rows: size[1],
            chunks,
            texts: &[],
        }
    }
}

/// The pages as a little-endian file, with a description on the first.
fn tiff(pages: &[Page], description: &str) -> Vec<u8> {
    let mut file = b"II*\0\0\0\0\0".to_vec();
    let mut link = 4;
    for (number, page) in pages.iter().enumerate() {
        let offsets: Vec<u32> = page.chunks.iter().map(|chunk| append(&mut file, chunk)).collect();
        let lengths: Vec<u32> = page.chunks.iter().map(|chunk| chunk.len() as u32).collect();
        let shorts = |value: u16| vec![value; page.samples.into()];
        let mut fields = vec![
            long(256, &[page.size[0]]),
            long(257, &[page.size[1]]),
            short(258, &shorts(page.bits)),
            short(259, &[1]),
            short(262, &[page.photometric]),
            short(277, &[page.samples]),
            short(284, &[if page.samples > 1 { 2 } else { 1 }]),
            short(339, &shorts(page.format)),
        ];
        match page.tile {
            Some([width, height]) => {
                let tiles = [long(322, &[width]), long(323, &[height]), long(324, &offsets), long(325, &lengths)];
                fields.extend(tiles);
            }
            None => fields.extend([long(273, &offsets), long(278, &[page.rows]), long(279, &lengths)]),
        }
        if number == 0 && !description.is_empty() {
            fields.push((270, 2, description.len() as u32 + 1, [description.as_bytes(), &[0]].concat()));
        }
        for (tag, text) in page.texts {
            fields.push((*tag, 2, text.len() as u32 + 1, [text.as_bytes(), &[0]].concat()));
        }
        fields.sort_by_key(|field| field.0);
        let values: Vec<[u8; 4]> = fields
            .iter()
            .map(|(.., bytes)| match bytes.len() {
                0..=4 => [&bytes[..], &[0; 4]].concat()[..4].try_into().unwrap(),
                _ => append(&mut file, bytes).to_le_bytes(),
            })
            .collect();
        let directory = append(&mut file, &(fields.len() as u16).to_le_bytes());
        file[link..link + 4].copy_from_slice(&directory.to_le_bytes());
        for ((tag, kind, count, _), value) in fields.iter().zip(values) {
            file.extend([&tag.to_le_bytes()[..], &kind.to_le_bytes(), &count.to_le_bytes(), &value].concat());
        }
        link = file.len();
        file.extend([0; 4]);
    }
    file
}

/// Tag, type, count, bytes.
type Field = (u16, u16, u32, Vec<u8>);

fn short(tag: u16, values: &[u16]) -> Field {
    (tag, 3, values.len() as u32, values.iter().flat_map(|v| v.to_le_bytes()).collect())
}

fn long(tag: u16, values: &[u32]) -> Field {
    (tag, 4, values.len() as u32, values.iter().flat_map(|v| v.to_le_bytes()).collect())
}

fn append(file: &mut Vec<u8>, bytes: &[u8]) -> u32 {
    file.resize(file.len().next_multiple_of(2), 0);
    let at = file.len() as u32;
    file.extend(bytes);
    at
}

/// Three colour planes of 20 x 18 pixels.
fn planes() -> [Vec<u8>; 3] {
    std::array::from_fn(|plane| random_voxels([20, 18, 1], VoxelType::U8, plane as u64))
}

/// The planes in strips of 4 rows, and in tiles of 16 x 16.
fn in_planes(photometric: u16) -> [Page; 2] {
    let mut strips = Page { samples: 3, photometric, rows: 4, ..Page::grey([20, 18], 8, WHOLE, &[]) };
    strips.chunks = planes().iter().flat_map(|plane| plane.chunks(80).map(<[u8]>::to_vec)).collect();
    let tile = |plane: &[u8], [across, down]: [usize; 2]| -> Vec<u8> {
        let pixel = |x: usize, y: usize| plane.get(y * 20 + x).copied().filter(|_| x < 20).unwrap_or(77);
        (0..256).map(|at| pixel(across * 16 + at % 16, down * 16 + at / 16)).collect()
    };
    let places = [[0, 0], [1, 0], [0, 1], [1, 1]];
    let tiles = planes().iter().flat_map(|plane| places.map(|place| tile(plane, place))).collect();
    [strips.clone(), Page { tile: Some([16, 16]), chunks: tiles, ..strips }]
}

fn written(folder: &Path, bytes: &[u8]) -> PathBuf {
    let path = folder.join("v.tif");
    std::fs::write(&path, bytes).unwrap();
    path
}

fn chosen(path: &Path, channel: Option<u64>, series: Option<&str>) -> Result<Box<dyn VolumeSource>, SourceError> {
    let mut options = OpenOptions::default();
    (options.selection.channel, options.selection.series) = (channel, series.map(str::to_owned));
    open(path, &options)
}

#[test]
fn whole_numbers_of_64_bits_are_kept_in_what_holds_them() {
    let folder = tempfile::tempdir().unwrap();
    let numbers: Vec<i64> = (0..24).map(|n| 31 * n - 200).collect();
    let bytes: Vec<u8> = numbers.iter().flat_map(|n| n.to_le_bytes()).collect();
    let small: Vec<u8> = numbers.iter().flat_map(|n| (*n as i16).to_le_bytes()).collect();
    let page = |rows: u32| {
        let mut page = Page { rows, ..Page::grey([4, 6], 64, SIGNED, &[]) };
        page.chunks = bytes.chunks(rows as usize * 32).map(<[u8]>::to_vec).collect();
        page
    };
    for rows in [6, 4] {
        let source = chosen(&written(folder.path(), &tiff(&[page(rows)], "")), None, None).unwrap();
        assert_eq!((source.info().dims, source.info().voxel_type), (Dims([4, 6, 1]), VoxelType::I16));
        assert!(source.info().notes.iter().any(|note| note.to_string().contains("int64")), "{:?}", source.info().notes);
        check_boxes(source.as_ref(), &small, 3);
    }
    let positive: Vec<u8> = (0..24u64).flat_map(|n| (n << 40).to_le_bytes()).collect();
    let path = written(folder.path(), &tiff(&[Page::grey([4, 6], 64, WHOLE, &positive)], ""));
    assert_eq!(chosen(&path, None, None).unwrap().info().voxel_type, VoxelType::F64);
}

/// The highest bit of a byte comes first, and each row begins at a byte boundary.
#[test]
fn single_bits_are_zeros_and_ones() {
    let folder = tempfile::tempdir().unwrap();
    let bits = random_voxels([11, 5, 2], VoxelType::U8, 4).iter().map(|byte| byte & 1).collect::<Vec<u8>>();
    let packed = |row: &[u8]| -> Vec<u8> {
        row.chunks(8).map(|bits| bits.iter().enumerate().map(|(i, bit)| bit << (7 - i)).sum()).collect()
    };
    // tifffile writes truth values as white-is-zero, although true is 1.
    let of_tifffile: &[_] = &[(305, "tifffile.py")];
    for (photometric, texts, flip) in
        [(BLACK_IS_ZERO, &[][..], 0), (WHITE_IS_ZERO, &[][..], 1), (WHITE_IS_ZERO, of_tifffile, 0)]
    {
        let pages: Vec<Page> = bits
            .chunks(55)
            .map(|page| Page {
                photometric,
                texts,
                rows: 2,
                chunks: page.chunks(22).map(|rows| rows.chunks(11).flat_map(packed).collect()).collect(),
                ..Page::grey([11, 5], 1, WHOLE, &[])
            })
            .collect();
        let source = chosen(&written(folder.path(), &tiff(&pages, "")), None, None).unwrap();
        assert_eq!((source.info().dims, source.info().voxel_type), (Dims([11, 5, 2]), VoxelType::U8));
        check_boxes(source.as_ref(), &bits.iter().map(|bit| bit ^ flip).collect::<Vec<u8>>(), 3);
        assert_eq!(source.info().notes.len(), usize::from(photometric == WHITE_IS_ZERO), "{:?}", source.info().notes);
    }
}

/// Tags of GDAL.
#[test]
fn nodata_scale_and_unit_of_gdal() {
    let folder = tempfile::tempdir().unwrap();
    let metadata = "<GDALMetadata><Item name=\"SCALE\" sample=\"0\" role=\"scale\">0.5</Item><Item name=\"UNITTYPE\" \
                    sample=\"0\" role=\"unittype\">m</Item></GDALMetadata>";
    let bytes: Vec<u8> = [-9999i16, 1, 2, 3].iter().flat_map(|n| n.to_le_bytes()).collect();
    let page = Page { texts: &[(42113, "-9999 ")], ..Page::grey([2, 2], 16, SIGNED, &bytes) };
    let texts: &'static [_] = Box::leak(Box::new([(42112, metadata), (42113, "-9999 ")]));
    for (page, scale, unit) in [(page.clone(), 1.0, ""), (Page { texts, ..page }, 0.5, "m")] {
        let source = chosen(&written(folder.path(), &tiff(&[page], "")), None, None).unwrap();
        let info = source.info();
        assert_eq!((info.nodata, info.scale, info.unit.as_str()), (Some(-9999.0), scale, unit));
        assert!(info.notes.iter().any(|note| note.to_string().contains("absent: -9999")), "{:?}", info.notes);
    }
}

/// Slices in files of their own are explained as stacks are, if all agree.
#[test]
fn folders_of_calibrated_slices() {
    let folder = tempfile::tempdir().unwrap();
    let bytes: Vec<u8> = [-9999i16, 1, 2, 3].iter().flat_map(|n| n.to_le_bytes()).collect();
    let page = Page { texts: &[(42113, "-9999")], ..Page::grey([2, 2], 16, SIGNED, &bytes) };
    let write = |name: &str, page: &Page, text: &str| {
        std::fs::write(folder.path().join(name), tiff(std::slice::from_ref(page), text)).unwrap();
    };
    let found = || {
        let source = chosen(folder.path(), None, None).unwrap();
        let info = source.info();
        assert_eq!((info.format, info.dims), ("pictures", Dims([2, 2, 2])));
        (info.nodata, info.scale, info.offset, info.notes.iter().map(ToString::to_string).collect::<String>())
    };
    write("s0.tif", &page, "");
    write("s1.tif", &page, "");
    assert_eq!((found().0, found().1), (Some(-9999.0), 1.0));
    let line = "ImageJ=1.54f\nimages=1\ncf=0\nc0=-5.0\nc1=2.0\nvunit=HU\n";
    write("s1.tif", &page, line);
    assert!(found().0.is_none() && found().3.contains("calibrated differently"), "{:?}", found());
    write("s0.tif", &page, line);
    assert_eq!((found().0, found().1, found().2), (None, 2.0, -5.0));
}

#[test]
fn numbers_in_planes_of_their_own() {
    let folder = tempfile::tempdir().unwrap();
    let planes = planes();
    for page in in_planes(RGB) {
        let path = written(folder.path(), &tiff(&[page.clone(), page], ""));
        for (channel, plane) in planes.iter().enumerate() {
            let source = chosen(&path, Some(channel as u64), None).unwrap_or_else(|e| panic!("{e}"));
            check_boxes(source.as_ref(), &plane.repeat(2), 3);
        }
        let source = chosen(&path, None, None).unwrap();
        assert!(source.info().notes.iter().any(|note| note.to_string().contains("luminance")));
        let shares = [0.299, 0.587, 0.114];
        let luminance = |at: usize| (0..3).map(|c| shares[c] * f64::from(planes[c][at])).sum::<f64>();
        for at in [0, 19, 17 * 20 + 3, 359] {
            let found = value_at(source.as_ref(), [at as u64 % 20, at as u64 / 20, 1]);
            assert!((found - luminance(at)).abs() <= 0.51, "pixel {at}: {found} is not {}", luminance(at));
        }
    }
    // Channels that are not colours have no luminance.
    let path = written(folder.path(), &tiff(&in_planes(BLACK_IS_ZERO)[..1], ""));
    assert_refused(chosen(&path, None, None).map(|_| ()), &["3 numbers per voxel", "`channel` 0 to 2"]);
    check_boxes(chosen(&path, Some(2), None).unwrap().as_ref(), &planes[2], 3);
}

/// Two series of different sizes: the first, or the selected one.
#[test]
fn series_of_ome() {
    let folder = tempfile::tempdir().unwrap();
    let [first, second] = [[9, 7, 3], [5, 4, 2]].map(|size| random_voxels(size, VoxelType::U16, size[0]));
    let mut pages: Vec<Page> = first.chunks(126).map(|page| Page::grey([9, 7], 16, WHOLE, page)).collect();
    pages.extend(second.chunks(40).map(|page| Page::grey([5, 4], 16, WHOLE, page)));
    let image = |[x, y, z]: [u32; 3], spacing: f64, page: u32| {
        let data: String = (0..z).map(|i| format!("<TiffData FirstZ=\"{i}\" IFD=\"{}\"/>", page + i)).collect();
        format!(
            "<Image><Pixels DimensionOrder=\"XYZCT\" SizeX=\"{x}\" SizeY=\"{y}\" SizeZ=\"{z}\" SizeC=\"1\" SizeT=\"1\" \
             PhysicalSizeX=\"{spacing}\" PhysicalSizeY=\"{spacing}\" PhysicalSizeZ=\"2\">{data}</Pixels></Image>"
        )
    };
    let xml = format!("<?xml version=\"1.0\"?><OME>{}{}</OME>", image([9, 7, 3], 0.5, 0), image([5, 4, 2], 0.25, 3));
    let path = written(folder.path(), &tiff(&pages, &xml));
    let source = chosen(&path, None, None).unwrap();
    assert!(
        source
            .info()
            .notes
            .iter()
            .any(|n| n.to_string().contains("2 series") && n.to_string().contains("`series` 0 to 1"))
    );
    check_boxes(source.as_ref(), &first, 3);
    let source = chosen(&path, None, Some("1")).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!((source.info().dims, source.info().geometry.spacing), (Dims([5, 4, 2]), [0.25, 0.25, 2.0]));
    check_boxes(source.as_ref(), &second, 3);
    assert_refused(chosen(&path, None, Some("2")).map(|_| ()), &["`series` 2", "2 series"]);
    assert_refused(chosen(&path, None, Some("1.2.3")).map(|_| ()), &["`series` 1.2.3", "number"]);
    let plain = written(folder.path(), &tiff(&pages[..1], ""));
    assert_refused(chosen(&plain, None, Some("1")).map(|_| ()), &["only DICOM and OME-TIFF have series"]);
    // Pages of different sizes without a description.
    let plain = written(folder.path(), &tiff(&pages, ""));
    assert_refused(chosen(&plain, None, None).map(|_| ()), &["page 3", "9 x 7 pixels of 1 u16", "5 x 4 pixels"]);
}

#[test]
fn damaged_files() {
    let folder = tempfile::tempdir().unwrap();
    let bits = Page { rows: 5, ..Page::grey([11, 5], 1, WHOLE, &[0xa5; 10]) };
    let whole = Page::grey([4, 6], 64, WHOLE, &[0, 0, 0, 0, 0, 1, 0, 0].repeat(24));
    let [strips, tiles] = in_planes(RGB);
    for page in [bits, whole, strips, tiles] {
        let file = tiff(&[page], "");
        fuzz_header(folder.path(), "v.tif", &file, file.len(), 1500, |path| chosen(path, None, None));
    }
}
