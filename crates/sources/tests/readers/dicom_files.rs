//! DICOM: real files compared with pydicom and SimpleITK, series written by these tests, damaged files.

use std::path::Path;

use supervol_format::space::WorldSpace;
use supervol_format::{Dims, VoxelType};
use supervol_sources::input::selection::Selection;
use supervol_sources::open::{OpenOptions, open};
use supervol_sources::{SourceError, VolumeSource};

use crate::{dicom_support, grid_support};
use dicom_support::*;
use grid_support::*;

/// Name, dims, type, a voxel and its value; least, greatest and sum of all voxels. By pydicom; the folder by SimpleITK.
type RealFile = (&'static str, [u64; 3], VoxelType, ([u64; 3], f64), [f64; 3]);
const REAL_FILES: [RealFile; 9] = [
    ("brain_pd_19slices", [256, 256, 19], VoxelType::I16, ([100, 120, 9], 433.0), [0.0, 1059.0, 210_038_390.0]),
    ("odd/CT_small.dcm", [128, 128, 1], VoxelType::I16, ([3, 5, 0], 223.0), [128.0, 2191.0, 14_826_310.0]),
    ("odd/MR_small.dcm", [64, 64, 1], VoxelType::I16, ([3, 5, 0], 503.0), [127.0, 2145.0, 2_125_338.0]),
    ("odd/MR_small_RLE.dcm", [64, 64, 1], VoxelType::I16, ([3, 5, 0], 503.0), [127.0, 2145.0, 2_125_338.0]),
    ("odd/MR_small_bigendian.dcm", [64, 64, 1], VoxelType::I16, ([3, 5, 0], 503.0), [127.0, 2145.0, 2_125_338.0]),
    (
        "odd/J2K_pixelrep_mismatch.dcm",
        [512, 512, 1],
        VoxelType::I16,
        ([510, 509, 0], -2000.0),
        [-2000.0, 1896.0, -172_605_258.0],
    ),
    ("odd/image_dfl.dcm", [512, 512, 1], VoxelType::U8, ([510, 509, 0], 188.0), [0.0, 255.0, 33_322_688.0]),
    (
        "odd/rtdose.dcm",
        [10, 10, 15],
        VoxelType::U32,
        ([8, 7, 14], 887_000.0),
        [795_000.0, 1_254_000.0, 1_519_910_000.0],
    ),
    ("odd/emri_small.dcm", [64, 64, 10], VoxelType::U16, ([62, 61, 9], 150.0), [0.0, 467.0, 4_493_276.0]),
];

fn opened(path: &Path) -> Result<Box<dyn VolumeSource>, SourceError> {
    open(path, &OpenOptions::default())
}

fn choosing(path: &Path, change: impl FnOnce(&mut Selection)) -> Result<Box<dyn VolumeSource>, SourceError> {
    let mut options = OpenOptions::default();
    change(&mut options.selection);
    open(path, &options)
}

#[test]
fn real_files_are_what_pydicom_reads() {
    for (name, dims, voxel_type, (at, value), [least, greatest, sum]) in REAL_FILES {
        let Some(path) = data_file(&format!("dicom/{name}")) else { continue };
        let source = opened(&path).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!((source.info().dims, source.info().voxel_type), (Dims(dims), voxel_type), "{name}");
        assert_eq!(summary(source.as_ref(), at), (least, greatest, sum, value), "{name}");
        // The brain's padding value is 0, which is also the value of its air.
        assert_eq!(source.info().nodata, name.ends_with("CT_small.dcm").then_some(-2000.0), "{name}");
    }
}

#[test]
fn a_series_lies_where_simple_itk_places_it() {
    let Some(path) = data_file("dicom/brain_pd_19slices") else { return };
    let source = opened(&path).unwrap();
    let info = source.info();
    assert_eq!((info.space, info.axes[2].unit.as_str()), (WorldSpace::LeftPosteriorSuperior, "mm"));
    let world = info.geometry.world_from_index();
    let corners = [
        ([0.0, 0.0, 0.0], [-110.5, -79.3063, -65.7575]),
        ([255.0, 255.0, 18.0], [108.640_625, 120.957_550_583_695_54, 88.442_544_341_050_36]),
    ];
    for (index, expected) in corners {
        let distance = (world.transform_point3(index.into()) - glam::DVec3::from(expected)).length();
        // SimpleITK measures the average slice distance along the first normal; we measure from the first slice to the
        // last.
        assert!(distance < 0.02, "{index:?}: {distance} mm");
    }
    assert!(info.notes.iter().any(|note| note.to_string().contains("evenly")), "{:?}", info.notes);
    let Some(path) = data_file("dicom/odd/rtdose.dcm") else { return };
    let dose = opened(&path).unwrap();
    let [x, y, z] = dose.info().geometry.world_from_index().transform_point3([1.0, 2.0, 14.0].into()).to_array();
    assert_eq!([x, y, z], [199.43125, 219.43125, -691.87]);
    assert_eq!((dose.info().scale, dose.info().unit.as_str()), (1e-6, "RELATIVE"));
}

#[test]
fn colours_are_luminance_or_one_channel() {
    let Some(path) = data_file("dicom/odd/examples_rgb_color.dcm") else { return };
    let grey = opened(&path).unwrap();
    assert_eq!(grey.info().dims, Dims([320, 240, 1]));
    assert_eq!(summary(grey.as_ref(), [0; 3]).2, 2_713_193.0);
    let blue = choosing(&path, |s| s.channel = Some(2)).unwrap();
    assert_eq!(summary(blue.as_ref(), [0; 3]).2, 2_185_818.0);
    let error = choosing(&path, |s| s.channel = Some(3)).err().unwrap().to_string();
    assert!(error.contains("`channel` 3") && error.contains("last is number 2"), "{error}");
}

/// Five slices of 5 x 4 voxels, 2.5 mm apart along z, and their voxels, lowest slice first.
fn stack(slice: &Slice) -> (Vec<Slice>, Vec<u8>) {
    let at = |i: u16| Slice { instance: 9 - i, position: [1.0, -2.0, 10.0 + 2.5 * f64::from(i)], ..slice.clone() };
    ((0..5).map(at).collect(), random_voxels([5, 4, 5], VoxelType::I16, 4))
}

/// Writes slices under names without any order.
fn write(folder: &Path, slices: &[Slice], voxels: &[u8]) {
    for (i, (slice, voxels)) in slices.iter().zip(voxels.chunks(40)).enumerate() {
        let name = format!("IM{:04}-{}-{}", (i * 7 + 3) % 11, slice.series, slice.instance);
        std::fs::write(folder.join(name), slice.file(voxels)).unwrap();
    }
}

#[test]
fn slices_are_sorted_by_their_place() {
    let folder = tempfile::tempdir().unwrap();
    let (slices, voxels) = stack(&Slice::default());
    std::fs::create_dir(folder.path().join("deep")).unwrap();
    write(&folder.path().join("deep"), &slices, &voxels);
    std::fs::write(folder.path().join("notes.txt"), "not an image").unwrap();
    let source = opened(folder.path()).unwrap();
    check_boxes(source.as_ref(), &voxels, 9);
    let info = source.info();
    assert_eq!((info.scale, info.offset, info.unit.as_str()), (1.0, -1024.0, "HU"));
    assert_eq!(info.geometry.spacing, [0.25, 0.5, 2.5]);
    assert_eq!(info.geometry.origin, [1.0, -2.0, 10.0]);
    assert!(info.notes.iter().any(|note| note.to_string().starts_with("1 files of the folder")), "{:?}", info.notes);
    // From the other side of the patient: z decreases, and x with it, so that the grid is right-handed.
    let folder = tempfile::tempdir().unwrap();
    let (slices, _) = stack(&Slice { orientation: "-1\\0\\0\\0\\1\\0", ..Slice::default() });
    write(folder.path(), &slices, &voxels);
    let source = opened(folder.path()).unwrap();
    assert_eq!(source.info().geometry.origin, [1.0, -2.0, 20.0]);
    assert!(!source.info().geometry.is_left_handed());
    let last: Vec<u8> = voxels.chunks(40).rev().flatten().copied().collect();
    check_boxes(source.as_ref(), &last, 9);
}

#[test]
fn slices_that_are_missing_or_tilted() {
    let folder = tempfile::tempdir().unwrap();
    let (mut slices, voxels) = stack(&Slice::default());
    slices.remove(2);
    write(folder.path(), &slices, &voxels);
    assert_refused(
        opened(folder.path()),
        &["positions of slices", "5.000 mm between slices 1 and 2", "2.500 mm apart"],
    );
    let folder = tempfile::tempdir().unwrap();
    let (mut slices, voxels) = stack(&Slice::default());
    slices.iter_mut().enumerate().for_each(|(i, slice)| slice.position[1] += 0.5 * i as f64);
    write(folder.path(), &slices, &voxels);
    let source = opened(folder.path()).unwrap();
    let world = source.info().geometry.world_from_index();
    assert!((world.transform_point3([0.0, 0.0, 4.0].into()) - glam::DVec3::new(1.0, 0.0, 20.0)).length() < 1e-12);
    assert!(
        source.info().notes.iter().any(|note| note.to_string().contains("tilted by 11.31")),
        "{:?}",
        source.info().notes
    );
    // One slice beside the others.
    slices[2].position[1] += 5.0;
    let folder = tempfile::tempdir().unwrap();
    write(folder.path(), &slices, &voxels);
    assert_refused(opened(folder.path()), &["positions of slices", "from its place"]);
}

#[test]
fn series_and_time_points_are_chosen() {
    let folder = tempfile::tempdir().unwrap();
    let (slices, voxels) = stack(&Slice::default());
    let (others, _) = stack(&Slice { series: "1.2.4", number: 7, ..Slice::default() });
    let second: Vec<u8> = voxels.iter().map(|byte| byte ^ 0x55).collect();
    write(folder.path(), &slices, &voxels);
    write(folder.path(), &others, &second);
    assert_refused(opened(folder.path()), &["2 series", "`series`", "number 7", "UID 1.2.3", "CT a head"]);
    for series in ["7", "1.2.4"] {
        let source = choosing(folder.path(), |s| s.series = Some(series.into())).unwrap();
        check_boxes(source.as_ref(), &second, 2);
    }
    let error = choosing(folder.path(), |s| s.series = Some("8".into())).err().unwrap().to_string();
    assert!(error.contains("`series` 8") && error.contains("number 7"), "{error}");
    // Two volumes in one series, with equal numbers at equal places.
    let folder = tempfile::tempdir().unwrap();
    write(folder.path(), &slices, &voxels);
    let later: Vec<Slice> = slices.iter().map(|s| Slice { instance: s.instance + 100, ..s.clone() }).collect();
    write(folder.path(), &later, &second);
    check_boxes(opened(folder.path()).unwrap().as_ref(), &voxels, 3);
    check_boxes(choosing(folder.path(), |s| s.frame = Some(1)).unwrap().as_ref(), &second, 3);
    let error = choosing(folder.path(), |s| s.frame = Some(2)).err().unwrap().to_string();
    assert!(error.contains("`frame` 2") && error.contains("last is number 1"), "{error}");
    std::fs::remove_file(folder.path().join("IM0002-1.2.3-106")).unwrap();
    assert_refused(opened(folder.path()), &["as many at each place", "missing"]);
}

/// A damaged or unsupported file does not make another series of its folder unreadable.
#[test]
fn damaged_files_and_other_compressions_leave_other_series_alone() {
    let folder = tempfile::tempdir().unwrap();
    let (slices, voxels) = stack(&Slice::default());
    write(folder.path(), &slices, &voxels);
    let other = Slice { series: "1.2.9", number: 9, ..Slice::default() };
    let jpeg_ls = other.header().fragments(&[vec![0; 10]]).file("1.2.840.10008.1.2.4.80");
    std::fs::write(folder.path().join("other.dcm"), &jpeg_ls).unwrap();
    let chosen = |series: &str| choosing(folder.path(), |s| s.series = Some(series.into()));
    check_boxes(chosen("1.2.3").unwrap().as_ref(), &voxels, 2);
    assert_refused(chosen("9"), &["JPEG-LS", "gdcmconv"]);
    // Cut within its header.
    std::fs::write(folder.path().join("cut.dcm"), &jpeg_ls[..300]).unwrap();
    let source = chosen("1.2.3").unwrap();
    check_boxes(source.as_ref(), &voxels, 2);
    assert!(
        source.info().notes.iter().any(|n| n.to_string().starts_with("1 damaged files are left out")),
        "{:?}",
        source.info().notes
    );
    // A single series might contain the damaged file.
    std::fs::remove_file(folder.path().join("other.dcm")).unwrap();
    assert_refused(chosen("1.2.3"), &["cut.dcm"]);
}

/// Ramps of 24 x 18 pixels of 8, 12 and 16 bits, made by GDCM; see `tests/data/README.md`.
#[test]
fn jpeg_frames_are_decoded() {
    let ramp = |x: u64, y: u64, factor: u64| (x * 7 + y * 5) * factor;
    for (name, factor, voxel_type) in
        [("lossless-8", 1, VoxelType::U8), ("lossless-12", 16, VoxelType::U16), ("lossless-16", 250, VoxelType::U16)]
    {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../../tests/data/dicom/{name}.dcm"));
        let source = opened(&path).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!((source.info().dims.0, source.info().voxel_type), ([24, 18, 1], voxel_type), "{name}");
        for at in [[0, 0, 0], [23, 0, 0], [5, 17, 0], [23, 17, 0]] {
            assert_eq!(value_at(source.as_ref(), at), ramp(at[0], at[1], factor) as f64, "{name}, {at:?}");
        }
    }
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data/dicom/baseline.dcm");
    let source = opened(&path).unwrap_or_else(|e| panic!("{e}"));
    for at in [[0, 0, 0], [23, 0, 0], [5, 17, 0], [23, 17, 0]] {
        let found = value_at(source.as_ref(), at);
        assert!((found - ramp(at[0], at[1], 1) as f64).abs() <= 3.0, "{at:?}: {found}");
    }
}

/// Lossy 12-bit JPEG is refused by name, with a conversion.
#[test]
fn jpeg_of_twelve_bits() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data/dicom/baseline.dcm");
    let mut file = std::fs::read(path).unwrap();
    let frame = file.windows(4).position(|bytes| bytes == [0xff, 0xc0, 0, 11]).unwrap();
    (file[frame + 1], file[frame + 4]) = (0xc1, 12);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("v.dcm");
    std::fs::write(&path, file).unwrap();
    assert_refused(opened(&path).map(|_| ()), &["JPEG with loss of 12 bits", "gdcmconv --raw"]);
}

/// JPEG colours declared as red, green and blue are not taken for luma and chroma, nor returned as rows of one colour.
#[test]
fn colours_by_jpeg() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data/dicom/colours-rgb.dcm");
    for channel in 0..3 {
        let mut options = OpenOptions::default();
        options.selection.channel = Some(channel);
        let source = open(&path, &options).unwrap_or_else(|e| panic!("{e}"));
        for (x, y) in (0..16).flat_map(|y| (0..24).map(move |x| (x, y))) {
            let expected = [40 + 5 * x, 50 + 6 * y, 200 - 3 * x - 2 * y][channel as usize];
            let found = value_at(source.as_ref(), [x, y, 0]);
            assert!((found - expected as f64).abs() <= 4.0, "{channel} at {x}, {y}: {found}, {expected}");
        }
    }
}

#[test]
fn slopes_bits_localisers_and_links() {
    // A different slope per slice: values as f32.
    let folder = tempfile::tempdir().unwrap();
    let (mut slices, voxels) = stack(&Slice::default());
    slices[3].slope = "0.5";
    write(folder.path(), &slices, &voxels);
    // A localiser with the same series UID.
    let localiser = Slice { size: [4, 5], instance: 99, ..Slice::default() };
    std::fs::write(folder.path().join("loc"), localiser.file(&voxels[..40])).unwrap();
    let source = opened(folder.path()).unwrap();
    assert_eq!((source.info().voxel_type, source.info().dims), (VoxelType::F32, Dims([5, 4, 5])));
    let stored = |i: usize| f64::from(i16::from_le_bytes([voxels[2 * i], voxels[2 * i + 1]]));
    assert_eq!(value_at(source.as_ref(), [2, 1, 3]), stored(67) * 0.5 - 1024.0);
    assert_eq!(value_at(source.as_ref(), [2, 1, 2]), stored(47) - 1024.0);
    assert!(
        source.info().notes.iter().any(|note| note.to_string().contains("localisers")),
        "{:?}",
        source.info().notes
    );
    // Twelve significant bits of sixteen, with other data in the rest.
    let folder = tempfile::tempdir().unwrap();
    let (slices, _) = stack(&Slice { stored_bits: 12, ..Slice::default() });
    write(folder.path(), &slices, &voxels);
    let source = opened(folder.path()).unwrap();
    let kept: Vec<u8> = (0..100).flat_map(|i| ((stored(i) as i16) << 4 >> 4).to_le_bytes()).collect();
    check_boxes(source.as_ref(), &kept, 5);
    // Links to the outside of the folder.
    #[cfg(unix)]
    {
        let outside = tempfile::tempdir().unwrap();
        for name in std::fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().file_name()) {
            std::os::unix::fs::symlink(folder.path().join(&name), outside.path().join(&name)).unwrap();
        }
        assert_refused(opened(outside.path()), &["a folder without files"]);
        let outside_too = supervol_sources::formats::metaimage::Outside::Allowed;
        let source = open(outside.path(), &OpenOptions { outside: outside_too, ..OpenOptions::default() }).unwrap();
        check_boxes(source.as_ref(), &kept, 5);
    }
}

/// Five frames in one file, highest first, each with its own position.
fn many_frames(is_delimited: bool) -> Dicom {
    let frame = |i: u32| {
        let position = Dicom::default().with(0x0020_0032, "DS", format!("1\\-2\\{}", 20.0 - 2.5 * f64::from(i)));
        Dicom::default().sequence(0x0020_9113, &[position], is_delimited)
    };
    let shared = Dicom::default()
        .sequence(0x0020_9116, &[Dicom::default().with(0x0020_0037, "DS", "1\\0\\0\\0\\1\\0")], is_delimited)
        .sequence(0x0028_9110, &[Dicom::default().with(0x0028_0030, "DS", "0.5\\0.25")], is_delimited)
        .sequence(0x0028_9145, &[Dicom::default().with(0x0028_1053, "DS", "2")], is_delimited);
    let frames: Vec<Dicom> = (0..5).map(frame).collect();
    Dicom::default()
        .with(0x0008_0060, "CS", "MR")
        .with(0x0020_000e, "UI", "1.2.3")
        .word(0x0028_0002, 1)
        .with(0x0028_0004, "CS", "MONOCHROME2")
        .with(0x0028_0008, "IS", "5")
        .word(0x0028_0010, 4)
        .word(0x0028_0011, 5)
        .word(0x0028_0100, 16)
        .word(0x0028_0101, 16)
        .word(0x0028_0102, 15)
        .word(0x0028_0103, 1)
        .sequence(0x5200_9229, &[shared], is_delimited)
        .sequence(0x5200_9230, &frames, is_delimited)
}

#[test]
fn many_frames_in_one_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("enhanced");
    let voxels = random_voxels([5, 4, 5], VoxelType::I16, 4);
    let upwards: Vec<u8> = voxels.chunks(40).rev().flatten().copied().collect();
    for is_delimited in [false, true] {
        let compressed: Vec<Vec<u8>> = voxels.chunks(40).map(rle).collect();
        let plain = many_frames(is_delimited).with(0x7fe0_0010, "OW", &voxels).file(EXPLICIT);
        for file in [plain, many_frames(is_delimited).fragments(&compressed).file(RLE)] {
            std::fs::write(&path, file).unwrap();
            let source = opened(&path).unwrap();
            check_boxes(source.as_ref(), &upwards, 7);
            assert_eq!(source.info().geometry.spacing, [0.25, 0.5, 2.5]);
            assert_eq!((source.info().geometry.origin, source.info().scale), ([1.0, -2.0, 10.0], 2.0));
        }
    }
    let file = many_frames(true).with(0x7fe0_0010, "OW", &voxels[..190]).file(EXPLICIT);
    std::fs::write(&path, file).unwrap();
    assert_refused(opened(&path), &["pixels of 200 bytes", "190 bytes"]);
    let jpeg_ls = many_frames(true).fragments(&[vec![0; 10]]).file("1.2.840.10008.1.2.4.80");
    std::fs::write(&path, jpeg_ls).unwrap();
    assert_refused(opened(&path), &["JPEG-LS", "gdcmconv"]);
}

#[test]
fn damaged_files() {
    let folder = tempfile::tempdir().unwrap();
    let voxels = random_voxels([5, 4, 5], VoxelType::I16, 8);
    let compressed: Vec<Vec<u8>> = voxels.chunks(40).map(rle).collect();
    let files = [
        Slice::default().file(&voxels[..40]),
        many_frames(false).with(0x7fe0_0010, "OW", &voxels).file(EXPLICIT),
        many_frames(true).with(0x7fe0_0010, "OW", &voxels).file(EXPLICIT),
        many_frames(true).fragments(&compressed).file(RLE),
    ];
    for file in files {
        // The bytes before the mark are arbitrary.
        fuzz_header(folder.path(), "v.dcm", &file, file.len(), 6000, opened);
    }
    for name in ["odd/J2K_pixelrep_mismatch.dcm", "odd/image_dfl.dcm"] {
        let Some(path) = data_file(&format!("dicom/{name}")) else { continue };
        let file = std::fs::read(path).unwrap();
        fuzz_header(folder.path(), "v.dcm", &file, file.len(), 60, opened);
    }
    let largest = largest_allocation::largest_bytes();
    assert!(largest <= 64 << 20, "{largest} bytes at once");
}
