//! Values explained by attributes, axes by name, absent values: files of other programs with their right values, and
//! files written by these tests.

use std::path::Path;

use supervol_format::voxel_type::voxels_as_f64;
use supervol_format::{Dims, VoxelType};
use supervol_sources::formats::segy::Duplicates;
use supervol_sources::input::values::Values;
use supervol_sources::open::{OpenOptions, open};
use supervol_sources::{SourceError, VolumeSource};

use crate::{dicom_support, grid_support};
use dicom_support::*;
use grid_support::*;

fn opened(path: &Path, choose: impl FnOnce(&mut OpenOptions)) -> Result<Box<dyn VolumeSource>, SourceError> {
    let mut options = OpenOptions::default();
    choose(&mut options);
    open(path, &options)
}

/// Values of all voxels, `None` for absent ones.
fn values(source: &dyn VolumeSource) -> Vec<Option<f64>> {
    let info = source.info();
    let is_absent = |stored: f64| !stored.is_finite() || info.nodata == Some(stored);
    let stored = voxels_as_f64(info.voxel_type, &read_all(source).unwrap());
    stored.into_iter().map(|v| (!is_absent(v)).then_some(v * info.scale + info.offset)).collect()
}

fn notes(source: &dyn VolumeSource) -> String {
    source.info().notes.iter().map(ToString::to_string).collect::<Vec<_>>().join("; ")
}

/// A temperature of 280 + z + y / 2 + x / 10, absent for y < 4.
#[test]
fn cf_attributes_of_netcdf_and_of_zarr_by_xarray() {
    for (name, unit, is_packed) in [
        ("cf_packed.nc:/temp", "K", true),
        ("cf_float.nc:/temp", "K", false),
        ("fill2.zarr", "", false),
        ("packed3.zarr", "", true),
    ] {
        let Some(folder) = data_file("cases") else { return };
        let source = opened(&folder.join(name), |_| ()).unwrap_or_else(|e| panic!("{e}"));
        let info = source.info();
        assert_eq!((info.dims, info.unit.as_str()), (Dims([14, 12, 10]), unit), "{name}");
        assert_eq!((info.geometry.spacing, info.axes[2].name.as_str()), ([1.0, 1.0, 10.0], "depth"), "{name}");
        for (at, value) in values(source.as_ref()).into_iter().enumerate() {
            let [x, y, z] = [at % 14, at / 14 % 12, at / 168].map(|i| i as f64);
            let expected = 280.0 + z + 0.5 * y + 0.1 * x;
            let is_right = value.map_or(y < 4.0, |value| y >= 4.0 && (value - expected).abs() < 2e-5);
            assert!(is_right, "{name} {at}: {value:?} is not {expected}");
        }
        assert!(notes(source.as_ref()).contains("attributes of the file are applied"), "{name}");
        let stored = opened(&folder.join(name), |o| o.values = Values::Stored).unwrap();
        let info = stored.info();
        assert_eq!((info.scale, info.offset, info.nodata, info.unit.as_str()), (1.0, 0.0, None, ""), "{name}");
        let least = values(stored.as_ref()).into_iter().flatten().fold(f64::INFINITY, f64::min);
        assert_eq!(least, if is_packed { -32767.0 } else { 282.0 }, "{name}");
    }
}

#[test]
fn calibrated_stacks_of_image_j_and_those_of_one_page() {
    let Some(folder) = data_file("cases") else { return };
    let source = opened(&folder.join("ij_signed.tif"), |_| ()).unwrap();
    let found = values(source.as_ref());
    assert_eq!((found[0], found[539]), (Some(-300.0), Some(239.0)));
    // 3 channels of 4 slices of 10 x 9 pixels; 2 times of 3 channels of 4 slices of 6 x 5: numbers in the order of the file.
    for (name, pixels, times) in [("one_ifd_zc.tif", 90, 1), ("one_ifd_tzc.tif", 30, 2)] {
        for (channel, frame) in (0..3).flat_map(|channel| (0..times).map(move |frame| (channel, frame))) {
            let choose = |o: &mut OpenOptions| {
                (o.selection.channel, o.selection.frame) = (Some(channel), (times > 1).then_some(frame));
            };
            let source = opened(&folder.join(name), choose).unwrap();
            for slice in 0..4 {
                let first = ((frame * 4 + slice) * 3 + channel) * pixels;
                assert_eq!(value_at(source.as_ref(), [0, 0, slice]), first as f64, "{name} {channel} {frame} {slice}");
            }
        }
    }
}

#[test]
fn a_survey_of_mdio() {
    let Some(path) = data_file("cases/v3.mdio") else { return };
    let source = opened(&path, |_| ()).unwrap();
    let info = source.info();
    assert_eq!((info.dims, info.geometry.spacing), (Dims([12, 10, 15]), [12.5, 25.0, 4.0]));
    let survey = info.survey.as_ref().expect("a survey");
    assert_eq!((survey.inline.first, survey.inline.step, survey.inline.count), (100, 2, 10));
    assert_eq!((survey.crossline.first, survey.crossline.step, survey.crossline.count), (300, 1, 12));
    let corners =
        [[430_000.0, 6_470_000.0], [430_137.5, 6_470_000.0], [430_000.0, 6_470_225.0], [430_137.5, 6_470_225.0]];
    assert_eq!((survey.corners, survey.sample_interval, survey.missing_traces), (Some(corners), 4.0, 0));
    let axes = info.axes.each_ref().map(|axis| (axis.name.as_str(), axis.unit.as_str()));
    assert_eq!(axes, [("crossline", "m"), ("inline", "m"), ("time", "ms")]);
    // Other names of the axes are the user's wish.
    let names = |o: &mut OpenOptions| o.selection.axes = ["z", "y", "x"].map(Into::into).into();
    let plain = opened(&path.join("amplitude"), names).unwrap();
    assert_eq!((plain.info().dims, plain.info().survey.is_none()), (Dims([15, 12, 10]), true));
    for (axes, words) in [(&["z", "y"][..], "3 names"), (&["z", "z", "x"], "different")] {
        let wrong = |o: &mut OpenOptions| o.selection.axes = axes.iter().map(ToString::to_string).collect();
        assert_refused(opened(&path, wrong).map(|_| ()), &["`axes`", words]);
    }
}

#[test]
fn legacy_files_of_big_data_viewer_are_unsigned() {
    let Some(folder) = data_file("cases") else { return };
    for name in ["legacy.xml", "legacy.h5"] {
        let source = opened(&folder.join(name), |_| ()).unwrap();
        assert_eq!(
            (source.info().voxel_type, value_at(source.as_ref(), [8, 0, 0])),
            (VoxelType::U16, 34952.0),
            "{name}"
        );
    }
}

#[test]
fn a_negative_spacing_turns_the_axis() {
    let Some(path) = data_file("cases/neg.mha") else { return };
    let geometry = opened(&path, |_| ()).unwrap().info().geometry;
    assert_eq!(geometry.spacing, [1.0, 2.0, 3.0]);
    assert_eq!(geometry.direction, [1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, 1.0]);
}

#[test]
fn data_of_hdf5_in_other_files() {
    let Some(folder) = data_file("cases") else { return };
    let source = opened(&folder.join("external.h5"), |_| ()).unwrap();
    assert_eq!((source.info().dims, source.info().files.len()), (Dims([10, 9, 8]), 2));
    assert_eq!((value_at(source.as_ref(), [0; 3]), value_at(source.as_ref(), [9, 8, 7])), (0.0, 719.0));
    // The file that a link leads to is not there.
    assert_refused(opened(&folder.join("link.h5"), |_| ()).map(|_| ()), &["fill_7.h5", "no such file"]);
    let empty = tempfile::tempdir().unwrap();
    std::fs::copy(folder.join("external.h5"), empty.path().join("external.h5")).unwrap();
    assert_refused(opened(&empty.path().join("external.h5"), |_| ()).map(|_| ()), &["raw.bin", "no such file"]);
}

/// The mapping counts if nothing is rescaled; else it is noted.
#[test]
fn real_world_values_of_dicom() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.dcm");
    let double = |value: f64| value.to_le_bytes();
    let unit = Dicom::default().with(0x0008_0100, "SH", "mm2/s");
    let mapping = Dicom::default().sequence(0x0040_08ea, &[unit], true).with(0x0040_9224, "FD", double(-2.0)).with(
        0x0040_9225,
        "FD",
        double(0.5),
    );
    let pixels: Vec<u8> = (0..20i16).flat_map(i16::to_le_bytes).collect();
    for (intercept, expected) in [("0", (0.5, -2.0, "mm2/s")), ("-1024", (1.0, -1024.0, "HU"))] {
        let header = Slice::default().header().with(0x0028_1052, "DS", intercept);
        let file = header.sequence(0x0040_9096, std::slice::from_ref(&mapping), true);
        std::fs::write(&path, file.with(0x7fe0_0010, "OW", &pixels).file(EXPLICIT)).unwrap();
        let source = opened(&path, |_| ()).unwrap();
        let info = source.info();
        assert_eq!((info.scale, info.offset, info.unit.as_str()), expected);
        assert!(notes(source.as_ref()).contains("real-world value mapping"), "{}", notes(source.as_ref()));
        let stored = opened(&path, |o| o.values = Values::Stored).unwrap();
        assert_eq!((stored.info().scale, stored.info().offset, stored.info().unit.as_str()), (1.0, 0.0, ""));
    }
}

/// A value given by hand is absent besides the file's, in every format.
#[test]
fn values_that_the_user_calls_absent() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.npy");
    let header = format!("{:<117}\n", "{'descr': '<i2', 'fortran_order': False, 'shape': (1, 2, 3), }");
    let numbers: Vec<u8> = [-999i16, 1, 2, 3, -999, 5].iter().flat_map(|n| n.to_le_bytes()).collect();
    let start = [&b"\x93NUMPY\x01\x00"[..], &118u16.to_le_bytes(), header.as_bytes()].concat();
    std::fs::write(&path, [start, numbers].concat()).unwrap();
    let source = opened(&path, |o| o.nodata = Some(-999.0)).unwrap();
    assert_eq!(values(source.as_ref()), [None, Some(1.0), Some(2.0), Some(3.0), None, Some(5.0)]);
    assert_eq!(source.info().reading, [("nodata", "-999".to_owned())]);
    assert_refused(opened(&path, |o| o.nodata = Some(1e6)).map(|_| ()), &["`nodata` 1000000", "i16"]);
    let Some(packed) = data_file("cases/cf_packed.nc") else { return };
    // 282.5 is stored as 250: the value of x = 5, y = 4, z = 0.
    let source = opened(&packed, |o| o.nodata = Some(282.5)).unwrap();
    let found = values(source.as_ref());
    assert_eq!((found[4 * 14 + 5], found[4 * 14 + 6].is_some(), found[0]), (None, true, None));
    let axes = |o: &mut OpenOptions| o.selection.axes = vec!["x".into()];
    assert_refused(opened(&data_file("cases/neg.mha").unwrap(), axes).map(|_| ()), &["`axes`", "NumPy"]);
}

#[test]
fn traces_that_are_left_out_and_traces_at_one_place() {
    let Some(folder) = data_file("cases") else { return };
    let (padded, double) = (folder.join("one_zero.sgy"), folder.join("dup_same.sgy"));
    assert_refused(opened(&padded, |_| ()).map(|_| ()), &["trace 81", "`skip_traces` 81"]);
    let source = opened(&padded, |o| o.segy.skip_traces = vec![[81, 81]]).unwrap();
    assert_eq!(source.info().dims, Dims([10, 8, 12]));
    assert!(notes(source.as_ref()).contains("1 traces were left out by hand"), "{}", notes(source.as_ref()));
    assert_refused(opened(&padded, |o| o.segy.skip_traces = vec![[3, 2]]).map(|_| ()), &["`skip_traces` 3-2"]);
    // Trace 43 repeats trace 18.
    assert_refused(opened(&double, |_| ()).map(|_| ()), &["traces 18 and 43", "`duplicates`", "`skip_traces` 43"]);
    let skipped = opened(&double, |o| o.segy.skip_traces = vec![[43, 43]]).unwrap();
    let expected = read_all(skipped.as_ref()).unwrap();
    for duplicates in [Duplicates::First, Duplicates::Last, Duplicates::Mean] {
        let source = opened(&double, |o| o.segy.duplicates = duplicates).unwrap();
        assert_eq!(source.info().dims, Dims([7, 6, 40]), "{duplicates:?}");
        check_boxes(source.as_ref(), &expected, 3);
        let said = source.info().reading.iter().find(|(name, _)| *name == "on_duplicate");
        assert_eq!(said.map(|(_, said)| said.as_str()), Some(duplicates.name()));
    }
    // The repeated trace is 100 more: the choice decides.
    let mut bytes = std::fs::read(&double).unwrap();
    let at = bytes.len() - 160;
    for sample in bytes[at..].as_chunks_mut::<4>().0 {
        *sample = (f32::from_be_bytes(*sample) + 100.0).to_be_bytes();
    }
    let changed = tempfile::tempdir().unwrap();
    let path = changed.path().join("a.sgy");
    std::fs::write(&path, bytes).unwrap();
    let first = value_at(skipped.as_ref(), [3, 2, 20]);
    for (duplicates, more) in [(Duplicates::First, 0.0), (Duplicates::Last, 100.0), (Duplicates::Mean, 50.0)] {
        let source = opened(&path, |o| o.segy.duplicates = duplicates).unwrap();
        let found = value_at(source.as_ref(), [3, 2, 20]);
        assert!((found - first - more).abs() < 1e-3, "{duplicates:?}: {found} is not {first} + {more}");
        assert_eq!(value_at(source.as_ref(), [4, 2, 20]), value_at(skipped.as_ref(), [4, 2, 20]), "{duplicates:?}");
    }
}

#[test]
fn ibm_floats_that_are_declared_as_ieee() {
    let Some(path) = data_file("cases/ibm_says_ieee.sgy") else { return };
    assert_refused(opened(&path, |_| ()).map(|_| ()), &["the samples are IBM floats", "`format` 1"]);
    let source = opened(&path, |o| o.segy.format = Some(1)).unwrap();
    assert!((value_at(source.as_ref(), [1, 0, 0]) - 99.83).abs() < 0.01);
}

/// Segmentations leave out slices in which nothing is marked.
#[test]
fn segmentations_of_dicom() {
    let frame = |z: f64, segment: Option<u16>| {
        let place = Dicom::default().with(0x0020_0032, "DS", format!("0\\0\\{z}"));
        let frame = Dicom::default().sequence(0x0020_9113, &[place], true);
        segment.map_or(frame.clone(), |segment| {
            frame.sequence(0x0062_000a, &[Dicom::default().word(0x0062_000b, segment)], true)
        })
    };
    let segment = |number: u16, label: &str| Dicom::default().word(0x0062_0004, number).with(0x0062_0005, "LO", label);
    let measures = Dicom::default().with(0x0018_0088, "DS", "2").with(0x0028_0030, "DS", "1\\1");
    let shared = Dicom::default()
        .sequence(0x0020_9116, &[Dicom::default().with(0x0020_0037, "DS", "1\\0\\0\\0\\1\\0")], true)
        .sequence(0x0028_9110, &[measures], true);
    let bytes = |frames: usize| (1..=frames).flat_map(|number| vec![number as u8; 6]).collect::<Vec<u8>>();
    let file = |frames: &[Dicom], bits: u16, pixels: Vec<u8>| {
        Dicom::default()
            .with(0x0008_0060, "CS", "SEG")
            .with(0x0020_000e, "UI", "1.2.3")
            .word(0x0028_0002, 1)
            .with(0x0028_0004, "CS", "MONOCHROME2")
            .with(0x0028_0008, "IS", frames.len().to_string())
            .word(0x0028_0010, 2)
            .word(0x0028_0011, 3)
            .word(0x0028_0100, bits)
            .word(0x0028_0101, bits)
            .word(0x0028_0102, bits - 1)
            .word(0x0028_0103, 0)
            .sequence(0x0062_0002, &[segment(1, "liver"), segment(2, "spleen")], true)
            .sequence(0x5200_9229, std::slice::from_ref(&shared), true)
            .sequence(0x5200_9230, frames, true)
            .with(0x7fe0_0010, "OB", pixels)
            .file(EXPLICIT)
    };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.dcm");
    let slices = |path: &Path, channel: Option<u64>| {
        let source = opened(path, |o| o.selection.channel = channel).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(source.info().geometry.spacing, [1.0, 1.0, 2.0]);
        let found = read_all(source.as_ref()).unwrap();
        (found.chunks(6).map(|slice| slice[0]).collect::<Vec<_>>(), notes(source.as_ref()))
    };
    // A label map without the slices at 4 mm and 8 mm.
    std::fs::write(&path, file(&[0.0, 2.0, 6.0, 10.0].map(|z| frame(z, None)), 8, bytes(4))).unwrap();
    let (found, said) = slices(&path, None);
    assert_eq!(found, [1, 2, 0, 3, 0, 4]);
    assert!(said.contains("2 slices of the segmentation"), "{said}");
    // Two segments, each in some slices.
    let frames = [frame(0.0, Some(1)), frame(6.0, Some(1)), frame(2.0, Some(2)), frame(4.0, Some(2))];
    std::fs::write(&path, file(&frames, 8, bytes(4))).unwrap();
    let (found, said) = slices(&path, None);
    assert_eq!(found, [1, 0, 0, 2]);
    assert!(said.contains("2 channels (liver, spleen)"), "{said}");
    assert_eq!(slices(&path, Some(1)).0, [3, 4]);
    // Single bits, lowest first: frames of six pixels follow each other without padding.
    let bits = [[1, 0, 0, 1, 1, 0], [0, 1, 0, 0, 0, 1], [1, 1, 1, 0, 0, 0], [0, 0, 0, 0, 0, 1u8]];
    let mut packed = vec![0u8; 4];
    bits.as_flattened().iter().enumerate().for_each(|(i, bit)| packed[i / 8] |= bit << (i % 8));
    std::fs::write(&path, file(&frames, 1, packed)).unwrap();
    let voxels = |channel| read_all(opened(&path, |o| o.selection.channel = channel).unwrap().as_ref()).unwrap();
    assert_eq!(voxels(None), [bits[0], [0; 6], [0; 6], bits[1]].concat());
    assert_eq!(voxels(Some(1)), [bits[2], bits[3]].concat());
    std::fs::write(&path, file(&frames, 1, vec![0; 2])).unwrap();
    assert_refused(opened(&path, |_| ()).map(|_| ()), &["pixels of 3 bytes", "2 bytes"]);
}

/// A segmentation of single bits by highdicom, with the slices that hold something.
#[test]
fn segmentations_of_single_bits() {
    let Some(path) = data_file("cases/two_sparse.dcm") else { return };
    let source = opened(&path, |_| ()).unwrap();
    let voxels = read_all(source.as_ref()).unwrap();
    assert!(voxels.iter().all(|voxel| *voxel <= 1) && voxels.contains(&1), "{:?}", source.info().dims);
}

/// A file that holds header and voxels counts once.
#[test]
fn files_count_once() {
    let Some(path) = data_file("cases/slope0.nii") else { return };
    let sizes: Vec<u64> = opened(&path, |_| ()).unwrap().info().files.iter().map(|file| file.bytes()).collect();
    assert_eq!(sizes, [772]);
    let Some(path) = data_file("nrrd/odd/small.nrrd") else { return };
    assert_eq!(opened(&path, |_| ()).unwrap().info().files.len(), 1);
}
