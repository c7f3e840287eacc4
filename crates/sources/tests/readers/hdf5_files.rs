//! HDF5: a real file, small files written by h5py in its oldest and newest layout (`tests/data/README.md`), damaged
//! files.

use std::path::{Path, PathBuf};

use supervol_format::random::Random;
use supervol_format::voxel_type::Voxel;
use supervol_format::{Dims, VoxelBox, VoxelType, with_voxel};
use supervol_sources::open::{OpenOptions, open};
use supervol_sources::{SourceError, VolumeSource};

use crate::grid_support;
use grid_support::*;

const DIMS: [u64; 3] = [12, 10, 9];
const FILES: [&str; 2] = ["old.h5", "new.h5"];

fn file(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data/hdf5").join(name)
}

fn named(path: &Path, dataset: &str) -> PathBuf {
    let mut path = path.as_os_str().to_owned();
    path.push(":/");
    path.push(dataset);
    path.into()
}

/// With a memory limit: sizes in a file must not determine allocations.
fn opened(path: &Path) -> Result<Box<dyn VolumeSource>, SourceError> {
    let mut options = OpenOptions::default();
    options.segy.memory_bytes = 64 << 20;
    open(path, &options)
}

fn value([x, y, z]: [u64; 3]) -> f64 {
    (3 * x + 5 * y + 7 * z + x * y * z % 11) as f64
}

fn voxels(voxel_type: VoxelType, value: impl Fn([u64; 3]) -> f64) -> Vec<u8> {
    let mut out = Vec::new();
    let mut voxel = [0; 8];
    for at in 0..DIMS.iter().product() {
        let place = [at % DIMS[0], at / DIMS[0] % DIMS[1], at / DIMS[0] / DIMS[1]];
        with_voxel!(voxel_type, V => V::from_f64(value(place)).write_le(&mut voxel[..size_of::<V>()]));
        out.extend_from_slice(&voxel[..voxel_type.bytes()]);
    }
    out
}

#[test]
fn datasets_are_what_h5py_wrote() {
    for name in FILES {
        for (dataset, voxel_type) in [
            ("plain", VoxelType::U16),
            ("big", VoxelType::I32),
            ("a/gzip", VoxelType::F32),
            ("a/checked", VoxelType::I16),
            // Without the attribute `dataType`, 16 bits are unsigned.
            ("t00000/s00/1/cells", VoxelType::U16),
        ] {
            let source = opened(&named(&file(name), dataset)).unwrap_or_else(|e| panic!("{e}"));
            let info = source.info();
            assert_eq!((info.dims, info.voxel_type, info.format), (Dims(DIMS), voxel_type, "hdf5"), "{dataset}");
            check_boxes(source.as_ref(), &voxels(voxel_type, value), 5);
        }
        let whole = opened(&named(&file(name), "a/whole")).unwrap();
        check_boxes(whole.as_ref(), &voxels(VoxelType::I16, |at| value(at) - 5.0), 5);
        let holes = opened(&named(&file(name), "a/holes")).unwrap();
        let is_there = |[x, y, z]: [u64; 3]| x < 6 && y < 5 && z < 5;
        check_boxes(holes.as_ref(), &voxels(VoxelType::F64, |at| if is_there(at) { value(at) } else { -7.0 }), 5);
        let mut options = OpenOptions::default();
        (options.selection.frame, options.selection.channel) = (Some(1), Some(1));
        let five = open(&named(&file(name), "a/five"), &options).unwrap_or_else(|e| panic!("{e}"));
        check_boxes(five.as_ref(), &voxels(VoxelType::U8, |at| value(at) + 11.0), 5);
    }
}

/// LZF by h5py, and booleans, which h5py writes as enumerations. Unsupported kinds are refused by name.
#[test]
fn kinds_that_only_python_writes() {
    let lzf = opened(&named(&file("kinds.h5"), "lzf")).unwrap_or_else(|e| panic!("{e}"));
    check_boxes(lzf.as_ref(), &voxels(VoxelType::U16, value), 5);
    let mask = opened(&named(&file("kinds.h5"), "mask")).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(mask.info().voxel_type, VoxelType::I8);
    check_boxes(mask.as_ref(), &voxels(VoxelType::I8, |at| value(at) % 2.0), 5);
    let refused = |name: &str, words: &[&str]| assert_refused(opened(&file(name)).map(|_| ()), words);
    refused("complex.h5", &["k_space (compound or complex)", ".real"]);
    refused("virtual.h5", &["virtual dataset", "h5repack"]);
}

#[test]
fn spacings_are_read_where_they_are_written() {
    for name in FILES {
        let fiji = opened(&named(&file(name), "a/gzip")).unwrap();
        assert_eq!(fiji.info().geometry.spacing, [0.25, 0.5, 2.0]);
        assert_eq!(fiji.info().axes[0].unit, "um");
        let viewer = opened(&named(&file(name), "t00000/s00/1/cells")).unwrap();
        assert_eq!(viewer.info().geometry.spacing, [2.0, 2.0, 1.0]);
        assert!(viewer.info().notes.iter().any(|n| n.to_string().contains("`spacing`")), "{:?}", viewer.info().notes);
    }
}

#[test]
fn places_by_other_programs() {
    let levels = file("levels.h5");
    for setup in ["s00", "s01"] {
        let coarse = opened(&named(&levels, &format!("t00000/{setup}/1/cells"))).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!((coarse.info().geometry.spacing, value_at(coarse.as_ref(), [0; 3])), ([2.0, 2.0, 1.0], 40_000.0));
    }
    let sized = opened(&named(&levels, "sized")).unwrap();
    assert_eq!((sized.info().geometry.spacing, sized.info().axes[0].unit.as_str()), ([1.0, 2.0, 3.0], "um"));
    let itk = opened(&file("itk.h5")).unwrap_or_else(|e| panic!("{e}"));
    let (info, geometry) = (itk.info(), itk.info().geometry);
    assert_eq!((info.dims, value_at(itk.as_ref(), [4, 3, 2])), (Dims([5, 4, 3]), 59.0));
    assert_eq!((geometry.spacing, geometry.origin), ([0.5, 1.5, 2.5], [10.0, 20.0, 30.0]));
    assert_eq!(geometry.direction, [0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0]);
    assert_eq!(info.space, supervol_format::space::WorldSpace::LeftPosteriorSuperior);
}

/// Inlines descend in the file: they are read in reverse.
#[test]
fn a_survey_of_segysak() {
    let source = opened(&file("survey.nc")).unwrap_or_else(|e| panic!("{e}"));
    let info = source.info();
    let survey = info.survey.as_ref().expect("a survey");
    assert_eq!((survey.inline.first, survey.inline.step, survey.crossline.first), (6, 2, 20));
    assert_eq!(survey.corners.map(|corners| corners[0]), Some([1000.0, 5100.0]));
    assert_eq!((info.geometry.spacing, info.axes[2].name.as_str()), ([12.5, 25.0, 4.0], "time"));
    let inlines = 0..30u32;
    let of_slice = |z: u32| inlines.clone().map(move |at| ((4 - at / 6) * 42 + at % 6 * 7 + z) as f32);
    let expected: Vec<u8> = (0..7).flat_map(of_slice).flat_map(f32::to_le_bytes).collect();
    check_boxes(source.as_ref(), &expected, 5);
}

#[test]
fn files_with_several_datasets_ask_for_a_name() {
    for name in FILES {
        let refused = |path: &Path, words: &[&str]| assert_refused(opened(path).map(|_| ()), words);
        refused(&file(name), &["8 datasets", "a/gzip (9 x 10 x 12)", ":/"]);
        refused(&named(&file(name), "nothing"), &["no dataset `nothing`", "plain"]);
        refused(&named(&file(name), "text"), &["no array of whole or floating numbers"]);
        // The file that a link leads to is not there.
        refused(&named(&file(name), "elsewhere/x"), &["no dataset", "a link is not followed", "other.h5"]);
    }
}

#[test]
fn the_real_file_is_what_h5py_reads() {
    let Some(path) = data_file("hdf5/aneurysm_sense40.h5") else { return };
    let source = opened(&named(&path, "volume_1")).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!((source.info().dims, source.info().voxel_type), (Dims([84, 84, 69]), VoxelType::F32));
    let found = summary(source.as_ref(), [42, 28, 34]);
    let expected: [f64; 4] = [0.0, 1.0, 2531.353955850471, 0.07319182902574539];
    for (found, expected) in [found.0, found.1, found.2, found.3].into_iter().zip(expected) {
        assert!((found - expected).abs() <= 1e-9 * expected.abs(), "{found} is not {expected}");
    }
    let mut options = OpenOptions::default();
    options.selection.channel = Some(2);
    let vectors = open(&named(&path, "volume_0"), &options).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(vectors.info().dims, Dims([84, 84, 69]));
    let (least, greatest, ..) = summary(vectors.as_ref(), [0; 3]);
    assert_eq!([least, greatest], [-84.1979751586914, 221.8148956298828]);
}

/// Truncated files, or files with flipped bits, give an error or other voxels. They never cause a panic or exceed the
/// memory limit.
#[test]
fn damaged_files_are_errors_or_other_voxels() {
    let work = tempfile::tempdir().unwrap();
    let path = work.path().join("damaged.h5");
    for name in [FILES[0], FILES[1], "kinds.h5"] {
        let whole = std::fs::read(file(name)).unwrap();
        let mut random = Random::new(3);
        for round in 0..1500 {
            let mut damaged = whole.clone();
            if round % 4 == 0 {
                damaged.truncate(random.below(whole.len() as u64) as usize);
            } else {
                for _ in 0..=random.below(4) {
                    // Most decisive bytes are at the beginning.
                    let room = if random.below(2) == 0 { whole.len() as u64 } else { 4096 };
                    damaged[random.below(room) as usize] ^= 1 << random.below(8);
                }
            }
            std::fs::write(&path, &damaged).unwrap();
            for dataset in ["plain", "a/gzip", "a/whole", "a/five", "a/holes", "lzf", "mask"] {
                if let Ok(source) = opened(&named(&path, dataset)) {
                    let end = source.info().dims.0.map(|n| n.min(12));
                    let _ = read(source.as_ref(), VoxelBox { start: [0; 3], end });
                }
            }
        }
    }
    let largest = largest_allocation::largest_bytes();
    assert!(largest <= 64 << 20, "an allocation of {largest} bytes");
}

/// A `BigDataViewer` data set over these voxel data, in a folder.
fn viewer_xml(folder: &Path, loader: &str, data: &str) -> PathBuf {
    let path = folder.join("set.xml");
    let tag = loader.rsplit('.').next().unwrap();
    let setup = |id: u32| {
        format!(
            "<ViewSetup><id>{id}</id><voxelSize><unit>micrometer</unit><size>0.5 0.25 2.0</size></voxelSize></ViewSetup>"
        )
    };
    let moved = "<ViewTransform type=\"affine\"><affine>0.5 0 0 10 0 0.25 0 20 0 0 2 30</affine></ViewTransform>";
    let text = format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<SpimData version=\"0.2\">\n <BasePath type=\"relative\">.</BasePath>\n \
         <SequenceDescription><ImageLoader format=\"{loader}\"><{tag} type=\"relative\">{data}</{tag}></ImageLoader>\
         <ViewSetups>{}{}</ViewSetups></SequenceDescription>\n <ViewRegistrations>\
         <ViewRegistration timepoint=\"0\" setup=\"0\">{moved}</ViewRegistration>\
         <ViewRegistration timepoint=\"4\" setup=\"0\"/></ViewRegistrations></SpimData>",
        setup(0),
        setup(1)
    );
    std::fs::write(&path, text).unwrap();
    path
}

fn of_level(path: &Path, choose: impl FnOnce(&mut OpenOptions)) -> Result<Box<dyn VolumeSource>, SourceError> {
    let mut options = OpenOptions::default();
    options.segy.memory_bytes = 64 << 20;
    options.selection.level = Some(1);
    choose(&mut options);
    open(path, &options)
}

#[test]
fn data_sets_of_big_data_viewer_are_read_with_their_place() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::copy(file("old.h5"), folder.path().join("data.h5")).unwrap();
    let path = viewer_xml(folder.path(), "bdv.hdf5", "data.h5");
    let source = of_level(&path, |_| ()).unwrap_or_else(|e| panic!("{e}"));
    let info = source.info();
    assert_eq!((info.format, info.dims, info.voxel_type), ("bdv", Dims(DIMS), VoxelType::U16));
    check_boxes(source.as_ref(), &voxels(VoxelType::U16, value), 5);
    // Level 1 is half as fine along x and y; its first voxel lies at the middle of four fine voxels.
    assert_eq!((info.geometry.spacing, info.geometry.origin), ([1.0, 0.5, 2.0], [10.25, 20.125, 30.0]));
    assert_eq!(info.axes.each_ref().map(|axis| axis.unit.as_str()), ["um"; 3]);
    assert_eq!(
        info.files.iter().map(|f| f.path().to_owned()).collect::<Vec<_>>(),
        [path.clone(), folder.path().join("data.h5")]
    );
    let notes = info.notes.iter().map(ToString::to_string).collect::<Vec<_>>().join("; ");
    assert!(notes.contains("2 setups") && notes.contains("2 time points") && !notes.contains("`spacing`"), "{notes}");
    // Missing parts are reported as missing.
    let refused =
        |choose: fn(&mut OpenOptions), words: &[&str]| assert_refused(of_level(&path, choose).map(|_| ()), words);
    refused(|o| o.selection.level = Some(3), &["`level` 3", "t00000/s00/3/cells"]);
    refused(|o| o.selection.channel = Some(1), &["t00000/s01/1/cells"]);
    refused(|o| o.selection.channel = Some(2), &["`channel` 2", "the last is number 1"]);
    refused(|o| o.selection.frame = Some(1), &["t00004/s00/1/cells"]);
    refused(|o| o.selection.series = Some("a".into()), &["`series`"]);
}

#[test]
fn data_sets_of_big_data_viewer_name_nothing_that_is_not_theirs() {
    let folder = tempfile::tempdir().unwrap();
    let inside = folder.path().join("inside");
    std::fs::create_dir(&inside).unwrap();
    std::fs::copy(file("new.h5"), folder.path().join("data.h5")).unwrap();
    let outside = viewer_xml(&inside, "bdv.hdf5", "../data.h5");
    assert_refused(of_level(&outside, |_| ()).map(|_| ()), &["outside", "`outside`"]);
    let allowed = of_level(&outside, |o| o.outside = supervol_sources::formats::nrrd::Outside::Allowed);
    assert_eq!(allowed.unwrap_or_else(|e| panic!("{e}")).info().dims, Dims(DIMS));
    assert_refused(
        of_level(&viewer_xml(&inside, "bdv.hdf5", "none.h5"), |_| ()).map(|_| ()),
        &["nothing at", "none.h5"],
    );
    assert_refused(of_level(&viewer_xml(&inside, "bdv.hdf5", ""), |_| ()).map(|_| ()), &["the name of its data"]);
    let other = viewer_xml(&inside, "bdv.imagej.virtualstack", "x");
    assert_refused(of_level(&other, |_| ()).map(|_| ()), &["bdv.imagej.virtualstack", "bdv.n5"]);
}

/// Truncated or with a wrong byte, a data set is refused or read, without a panic or much memory.
#[test]
fn damaged_data_sets_of_big_data_viewer() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::copy(file("new.h5"), folder.path().join("data.h5")).unwrap();
    let path = viewer_xml(folder.path(), "bdv.hdf5", "data.h5");
    let whole = std::fs::read(&path).unwrap();
    let mut random = Random::new(5);
    let mut refused = 0;
    for round in 0..600 {
        let mut bytes = whole.clone();
        let at = random.below(bytes.len() as u64) as usize;
        if round % 3 == 0 {
            bytes.truncate(at)
        } else {
            bytes[at] ^= 1 << (round / 3 % 8)
        }
        std::fs::write(&path, &bytes).unwrap();
        refused += usize::from(of_level(&path, |_| ()).and_then(|source| read_all(source.as_ref()).map(drop)).is_err());
    }
    let largest = largest_allocation::largest_bytes();
    assert!(refused > 200 && largest < 32 << 20, "{refused} refused, {largest} bytes at once");
}
