use supervol_format::container::header::Descriptor;
use supervol_format::voxel_type::Absence;
use supervol_format::{BrickLayout, Dims, Geometry, Pyramid, ValueRange, VoxelType};

use super::*;

fn descriptor(voxel_type: VoxelType, scale: f64) -> Descriptor {
    let pyramid = Pyramid::new(Dims([8; 3]), BrickLayout::DEFAULT, &[]).expect("a pyramid");
    let (geometry, absence) = (Geometry::IDENTITY, Absence::NON_FINITE_ONLY);
    Descriptor { voxel_type, pyramid, geometry, scale, offset: 0.0, absence, quantizer: None }
}

/// Statistics of values, counted in parts on their own.
fn count(voxel_type: VoxelType, values: &[f64], parts: usize) -> Statistics {
    let bytes = |values: &[f64]| -> Vec<u8> {
        match voxel_type {
            VoxelType::F32 => values.iter().flat_map(|v| supervol_format::cast::single(*v).to_le_bytes()).collect(),
            VoxelType::F64 => values.iter().flat_map(|v| v.to_le_bytes()).collect(),
            VoxelType::I32 => values.iter().flat_map(|v| whole::<i32>(*v).to_le_bytes()).collect(),
            VoxelType::U32 => values.iter().flat_map(|v| whole::<u32>(*v).to_le_bytes()).collect(),
            other => unreachable!("{other}"),
        }
    };
    let mut all = Statistics::new(voxel_type);
    for part in values.rchunks(values.len().div_ceil(parts)) {
        let mut beside = all.beside();
        beside.add(&bytes(part), Absence::NON_FINITE_ONLY);
        all.merge(&beside);
    }
    all
}

fn resolved(voxel_type: VoxelType, values: &[f64], parts: usize) -> Values {
    Values::of(&descriptor(voxel_type, 1.0), &count(voxel_type, values, parts), Form::Resolved)
}

/// The value at a percentile by sorting.
fn exact(values: &[f64], percent: f64) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let share = sorted.len() as f64 * percent / 100.0;
    let reached = (1..=sorted.len()).position(|rank| rank as f64 >= share);
    sorted[reached.expect("the last rank reaches every share")]
}

/// Offsets and amplitudes of real quantities: pressure in pascal, temperature in kelvin, sound speed, density, depth.
const FIELDS: [(f64, f64); 7] = [
    (101_325.0, 200.0),
    (293.0, 20.0),
    (1500.0, 4.0),
    (1025.0, 3.0),
    (-4000.0, 1.0),
    (0.0, 110.0),
    (16_000_000.0, 8000.0),
];

#[test]
fn percentiles_resolve_the_data_at_any_offset_in_any_type() {
    for (offset, amplitude) in FIELDS {
        for voxel_type in [VoxelType::F32, VoxelType::F64, VoxelType::I32, VoxelType::U32] {
            let scale = if matches!(voxel_type, VoxelType::I32 | VoxelType::U32) { 10.0 } else { 1.0 };
            if voxel_type == VoxelType::U32 && offset <= 0.0 {
                continue;
            }
            let field =
                |i: i32| scale * (offset + amplitude * (f64::from(i) / 4e3).sin() * (f64::from(i) / 77.0).cos());
            let round = |v: f64| match voxel_type {
                VoxelType::F32 => f64::from(supervol_format::cast::single(v)),
                VoxelType::F64 => v,
                _ => v.trunc(),
            };
            let values: Vec<f64> = (0..120_000).map(|i| round(field(i))).collect();
            let found = resolved(voxel_type, &values, 3);
            let range = found.range.expect("voxels are present");
            for [percent, value] in &found.percentiles {
                let error = (value - exact(&values, *percent)).abs();
                assert!(error <= range.width() / 8192.0, "{offset} {voxel_type} {percent}: {error}");
            }
            assert_eq!(found.histogram.iter().sum::<u64>(), 120_000);
            let used = found.histogram.iter().filter(|count| **count > 0).count();
            assert!(used == HISTOGRAM_BINS || scale * amplitude < 128.0, "{offset} {voxel_type}: {used} bins");
            assert_eq!(found, resolved(voxel_type, &values, 1), "in one part or in several");
        }
    }
}

#[test]
fn outliers_move_neither_percentiles_nor_the_central_range() {
    let field: Vec<f64> = (0..50_000).map(|i| 110.0 * (f64::from(i) / 40.0).sin()).collect();
    for voxel_type in [VoxelType::F32, VoxelType::F64] {
        for far in [1e6, -1e8, 1e20, 1e30, -3.4e38] {
            let mut values = field.clone();
            values[777] = far;
            let found = resolved(voxel_type, &values, 2);
            let percentile = |p: f64| found.percentiles.iter().find(|pair| pair[0] == p).expect("it is listed")[1];
            for percent in PERCENTS {
                let error = (percentile(percent) - exact(&values, percent)).abs();
                assert!(error <= 220.0 / 4096.0, "{far} {percent}: {error}");
            }
            let central = found.distribution.and_then(|d| d.central).expect("a value is far");
            assert!((central.range.min + 110.0).abs() < 0.1 && (central.range.max - 110.0).abs() < 0.1, "{central:?}");
            assert_eq!(central.below + central.above, 1);
            assert_eq!(central.histogram.iter().sum::<u64>(), 49_999);
            let note = found.note.expect("it is named");
            assert!(note.starts_with("1 voxel of 50000 lies far"), "{note}");
        }
    }
}

#[test]
fn a_negative_scale_reverses_everything() {
    let mut values: Vec<f64> = (0..5000).map(f64::from).collect();
    values[3] = 1e12;
    let found = Values::of(&descriptor(VoxelType::F64, -1.0), &count(VoxelType::F64, &values, 2), Form::Resolved);
    let central = found.distribution.and_then(|d| d.central).expect("a value is far");
    assert_eq!((central.below, central.above), (1, 0));
    assert_eq!(central.range, ValueRange { min: -4999.0, max: 0.0 });
    assert!(central.percentiles.windows(2).all(|pair| pair[0][0] < pair[1][0] && pair[0][1] <= pair[1][1]));
}

#[test]
fn percentiles_of_bytes_are_exact_and_spikes_move_nothing() {
    let mut bytes = Statistics::new(VoxelType::U8);
    bytes.add(&(0..=255).collect::<Vec<u8>>(), Absence { nodata: Some(255.0) });
    assert_eq!((bytes.present(), bytes.distinct()), (255, Some(255)));
    assert_eq!(bytes.range(), ValueRange { min: 0.0, max: 254.0 });
    for form in [Form::Binned, Form::Resolved] {
        let values = Values::of(&descriptor(VoxelType::U8, 1.0), &bytes, form);
        assert!(values.percentiles.contains(&[50.0, 127.0]));
    }
}

#[test]
fn statistics_of_older_containers_are_found_again() {
    let values: Vec<f64> = (0..10_000).map(|i| if i == 17 { 1e7 } else { f64::from(i) }).collect();
    let found = Values::of(&descriptor(VoxelType::F32, 1.0), &count(VoxelType::F32, &values, 2), Form::Binned);
    // The middle of the bin from 9856 to 9919, which release 0.1.0 wrote.
    assert!(found.percentiles.contains(&[99.0, 9888.0]), "{:?}", found.percentiles);
    assert_eq!((found.distribution, found.note), (None, None));
}
