//! Files written by `extract`, read again: the same voxels at the same world positions, in every format, level and box.

use std::path::Path;

use glam::DVec3;
use supervol_export::extract::{Extraction, extract};
use supervol_files::OutputError;
use supervol_format::container::manifest::Source;
use supervol_format::level_reader::LevelReader;
use supervol_format::space::WorldSpace;
use supervol_format::voxel_type::voxels_as_f64;
use supervol_format::{BrickLayout, Container, Geometry, Lod, VoxelBox, VoxelType};
use supervol_preprocess::{BuildError, BuildOptions, Existing, build};
use supervol_sources::computed::Computed;
use supervol_sources::open::{OpenOptions, open};
use supervol_sources::{Axis, SourceInfo};

use crate::grid_support;
use grid_support::*;

const DIMS: [u64; 3] = [21, 18, 19];
const ENDS: [&str; 6] = ["nii", "nii.gz", "mha", "tif", "vti", "nrrd"];
const MEMORY_BYTES: u64 = 64 << 20;

/// A third of a turn about the diagonal, slightly sheared, without any power of two.
const OBLIQUE: Geometry = Geometry {
    spacing: [0.3, 0.7, 1.1],
    origin: [-12.3, 45.6, 7.0],
    direction: [0.0, 0.0, 1.0, 1.0, 0.0, 0.1, 0.0, 1.0, 0.0],
};

fn built(folder: &Path, voxel_type: VoxelType, change: impl FnOnce(&mut SourceInfo)) -> Container {
    let value = |[x, y, z]: [u64; 3]| (x * 3 + y * 5 + z * 7) as f64 % 120.0;
    let source = Computed::new(DIMS, voxel_type, value).with_info(|info| {
        info.geometry = OBLIQUE;
        info.axes = ["x", "y", "z"].map(|name| Axis { name: name.into(), unit: "mm".into() });
        change(info);
    });
    let origin = Source { name: "v".into(), format: "synth".into(), bytes: 0, xxh3_64: String::new() };
    let output = folder.join("v.svol");
    let options = BuildOptions {
        layout: BrickLayout::new(16).unwrap(),
        memory_bytes: MEMORY_BYTES,
        existing: Existing::Replace,
        ..BuildOptions::default()
    };
    build(&source, origin, &output, &options, &|_| ()).unwrap();
    Container::open(&output).unwrap()
}

fn extraction(lod: u8, voxels: Option<VoxelBox>) -> Extraction {
    Extraction { lod: Lod(lod), voxels, existing: Existing::Replace, memory_bytes: MEMORY_BYTES }
}

/// Converts a world point from one patient space to another.
fn in_space(point: DVec3, from: WorldSpace, to: WorldSpace) -> DVec3 {
    let is_other = from != WorldSpace::Unknown && to != WorldSpace::Unknown && from != to;
    if is_other { point * DVec3::new(-1.0, -1.0, 1.0) } else { point }
}

#[test]
fn voxels_and_their_places_are_the_same_before_and_after() {
    let folder = tempfile::tempdir().unwrap();
    let part = VoxelBox { start: [2, 3, 4], end: [15, 17, 18] };
    for space in [WorldSpace::Unknown, WorldSpace::RightAnteriorSuperior, WorldSpace::LeftPosteriorSuperior] {
        let container = built(folder.path(), VoxelType::I16, |info| info.space = space);
        for (lod, voxels) in [(0, None), (0, Some(part)), (1, None)] {
            for end in ENDS {
                let output = folder.path().join(format!("out.{end}"));
                let (whole, voxel_type) = extract(&container, &output, &extraction(lod, voxels)).unwrap();
                let source = open(&output, &OpenOptions::default()).unwrap_or_else(|e| panic!("{end}: {e}"));
                let info = source.info();
                assert_eq!((info.dims.full_box().extent(), info.voxel_type), (whole.extent(), voxel_type), "{end}");
                let mut expected = vec![0; whole.voxels() * 2];
                LevelReader::new(&container, Lod(lod), 0).read_box(whole, &mut expected).unwrap();
                assert!(read_all(source.as_ref()).unwrap() == expected, "{end}, level {lod}, {voxels:?}");
                assert_eq!(info.axes[0].unit, if end == "vti" { "" } else { "mm" }, "{end}");
                if end == "mha" && space != WorldSpace::Unknown {
                    assert_eq!(info.space, WorldSpace::LeftPosteriorSuperior, "it holds no other");
                }
                let scale = container.pyramid().level_at(Lod(lod)).scale;
                if end == "tif" {
                    let spacing: [f64; 3] = std::array::from_fn(|a| OBLIQUE.spacing[a] * scale[a] as f64);
                    assert_eq!(info.geometry.spacing, spacing);
                    continue;
                }
                for voxel in [[0, 0, 0], [9, 0, 0], [3, 8, 5]] {
                    let fine = |a: usize| ((whole.start[a] + voxel[a]) as f64 + 0.5) * scale[a] as f64 - 0.5;
                    let before = OBLIQUE.world_from_index().transform_point3(DVec3::from(std::array::from_fn(fine)));
                    let after = info.geometry.world_from_index().transform_point3(voxel.map(|i| i as f64).into());
                    let distance = (in_space(before, space, info.space) - after).length();
                    // NIfTI-1 holds single precision.
                    let least = if end.starts_with("nii") { 1e-5 } else { 1e-12 };
                    assert!(distance < least, "{end}, {space:?}, {voxel:?}: {distance}");
                }
            }
        }
    }
}

#[test]
fn every_type_of_voxel_comes_back() {
    let folder = tempfile::tempdir().unwrap();
    for voxel_type in VoxelType::ALL {
        let container = built(folder.path(), voxel_type, |_| ());
        let mut expected = vec![0; DIMS.iter().product::<u64>() as usize * voxel_type.bytes()];
        LevelReader::new(&container, Lod(0), 0)
            .read_box(container.pyramid().levels()[0].dims.full_box(), &mut expected)
            .unwrap();
        for end in ENDS {
            let output = folder.path().join(format!("out.{end}"));
            extract(&container, &output, &extraction(0, None)).unwrap();
            let source = open(&output, &OpenOptions::default()).unwrap_or_else(|e| panic!("{end}: {e}"));
            assert_eq!(source.info().voxel_type, voxel_type, "{end}");
            assert!(read_all(source.as_ref()).unwrap() == expected, "{end}: {voxel_type}");
        }
    }
}

/// Descriptions of even and of odd length end with one zero byte, and directories begin at even bytes.
#[test]
fn descriptions_of_tiff_end_with_one_zero_byte() {
    let folder = tempfile::tempdir().unwrap();
    let output = folder.path().join("out.tif");
    let mut lengths = [false; 2];
    for voxel_type in VoxelType::ALL {
        extract(&built(folder.path(), voxel_type, |_| ()), &output, &extraction(0, None)).unwrap();
        let bytes = std::fs::read(&output).unwrap();
        let number = |at: usize| u64::from_le_bytes(bytes[at..at + 8].try_into().unwrap()) as usize;
        let directory = number(8);
        assert_eq!(directory % 2, 0, "{voxel_type}");
        let entries = (0..number(directory)).map(|i| directory + 8 + 20 * i);
        let entry = entries.into_iter().find(|at| bytes[*at..*at + 2] == 270u16.to_le_bytes()).unwrap();
        let (count, at) = (number(entry + 4), number(entry + 12));
        let text = &bytes[at..at + count];
        assert!(text.ends_with(b"</OME>\0"), "{voxel_type}: {:?}", &text[count - 9..]);
        lengths[count % 2] = true;
    }
    assert_eq!(lengths, [true, true]);
}

#[test]
fn scaled_values_and_long_axes() {
    let folder = tempfile::tempdir().unwrap();
    let container = built(folder.path(), VoxelType::U8, |info| (info.scale, info.offset) = (0.5, -20.0));
    let output = folder.path().join("out.nii");
    extract(&container, &output, &extraction(0, None)).unwrap();
    let source = open(&output, &OpenOptions::default()).unwrap();
    let values = voxels_as_f64(VoxelType::F32, &read_all(source.as_ref()).unwrap());
    assert_eq!((source.info().voxel_type, values[4]), (VoxelType::F32, 12.0 * 0.5 - 20.0));
    // An axis that is too long for NIfTI-1.
    let long = Computed::new([40_000, 2, 1], VoxelType::U8, |[x, ..]| (x % 251) as f64)
        .with_info(|info| info.geometry = OBLIQUE);
    let origin = Source { name: "v".into(), format: "synth".into(), bytes: 0, xxh3_64: String::new() };
    let path = folder.path().join("long.svol");
    build(&long, origin, &path, &BuildOptions { memory_bytes: 256 << 20, ..BuildOptions::default() }, &|_| ()).unwrap();
    extract(&Container::open(&path).unwrap(), &output, &extraction(0, None)).unwrap();
    let source = open(&output, &OpenOptions::default()).unwrap();
    assert_eq!(source.info().dims.0, [40_000, 2, 1]);
    let (before, after) = (OBLIQUE.linear().to_cols_array(), source.info().geometry.linear().to_cols_array());
    assert!(before.iter().zip(after).all(|(a, b)| (a - b).abs() < 1e-12), "{before:?} {after:?}");
    assert_eq!(value_at(source.as_ref(), [39_999, 1, 0]), f64::from(39_999 % 251));
    let error = extract(&container, &folder.path().join("out.txt"), &extraction(0, None)).unwrap_err();
    assert!(matches!(&error, BuildError::Options(text) if text.contains(".nii.gz")), "{error}");
}

/// OME-Zarr written by `extract`: the same voxels at the same positions.
#[test]
fn ome_zarr_keeps_spacings_and_the_first_voxels_place() {
    let folder = tempfile::tempdir().unwrap();
    let container = built(folder.path(), VoxelType::I16, |_| ());
    let part = VoxelBox { start: [2, 3, 4], end: [15, 17, 18] };
    for (lod, voxels) in [(0, None), (0, Some(part)), (1, None)] {
        let output = folder.path().join("out.ome.zarr");
        let (whole, voxel_type) = extract(&container, &output, &extraction(lod, voxels)).unwrap();
        let source = open(&output, &OpenOptions::default()).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!((source.info().dims.full_box().extent(), source.info().voxel_type), (whole.extent(), voxel_type));
        let mut expected = vec![0; whole.voxels() * 2];
        LevelReader::new(&container, Lod(lod), 0).read_box(whole, &mut expected).unwrap();
        assert!(read_all(source.as_ref()).unwrap() == expected, "level {lod}, {voxels:?}");
        let scale = container.pyramid().level_at(Lod(lod)).scale;
        let index: [f64; 3] = std::array::from_fn(|a| (whole.start[a] as f64 + 0.5) * scale[a] as f64 - 0.5);
        let first = OBLIQUE.world_from_index().transform_point3(DVec3::from(index));
        let found = source.info().geometry;
        assert!((DVec3::from(found.origin) - first).length() < 1e-12);
        assert_eq!(found.spacing, std::array::from_fn(|a| OBLIQUE.spacing[a] * scale[a] as f64));
        assert_eq!(source.info().axes[0].unit, "mm");
    }
    // It is not overwritten without permission, and replaces nothing else.
    let output = folder.path().join("out.ome.zarr");
    let keep = Extraction { existing: Existing::Keep, ..extraction(0, None) };
    assert!(matches!(extract(&container, &output, &keep), Err(BuildError::Output(OutputError::Exists { .. }))));
    let other = folder.path().join("other.zarr");
    std::fs::create_dir(&other).unwrap();
    std::fs::write(other.join("kept"), "").unwrap();
    let error = extract(&container, &other, &extraction(0, None)).unwrap_err();
    assert!(error.to_string().contains("something else than a Zarr"), "{error}");
    assert!(other.join("kept").is_file());
    let names: Vec<_> = std::fs::read_dir(folder.path()).unwrap().map(|e| e.unwrap().file_name()).collect();
    assert_eq!(names.len(), 3, "nothing is left behind: {names:?}");
}

/// Chunks longer than the volume in some directions, and shorter in others.
#[test]
fn chunks_of_ome_zarr_are_filled_up() {
    let folder = tempfile::tempdir().unwrap();
    let value = |[x, y, z]: [u64; 3]| (x + 3 * y + 5 * z) as f64;
    let source = Computed::new([130, 65, 3], VoxelType::U16, value);
    let origin = Source { name: "v".into(), format: "synth".into(), bytes: 0, xxh3_64: String::new() };
    let path = folder.path().join("v.svol");
    build(&source, origin, &path, &BuildOptions::default(), &|_| ()).unwrap();
    let output = folder.path().join("v.zarr");
    extract(&Container::open(&path).unwrap(), &output, &extraction(0, None)).unwrap();
    let back = open(&output, &OpenOptions::default()).unwrap();
    check_boxes(back.as_ref(), &read_all(&source).unwrap(), 1);
}

#[test]
fn segy_keeps_lines_coordinates_and_samples() {
    for name in [
        "segy/real/volve_migvel_depth_sub3d.sgy",
        "segy/real/f3_int16_be.sgy",
        "segy/odd/dead_traces_30x41x4.segy",
        "segy/odd/small_negative_il_xl.sgy",
    ] {
        let Some(input) = data_file(name) else { return };
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("v.svol");
        let source = open(&input, &OpenOptions::default()).unwrap();
        let origin = Source { name: "v".into(), format: "segy".into(), bytes: 0, xxh3_64: String::new() };
        build(source.as_ref(), origin, &path, &BuildOptions::default(), &|_| ()).unwrap();
        let container = Container::open(&path).unwrap();
        let output = folder.path().join("out.sgy");
        extract(&container, &output, &extraction(0, None)).unwrap();
        let back = open(&output, &OpenOptions::default()).unwrap_or_else(|e| panic!("{name}: {e}"));
        let (before, after) = (source.info(), back.info());
        assert_eq!((before.dims, before.voxel_type), (after.dims, after.voxel_type), "{name}");
        assert!(read_all(source.as_ref()).unwrap() == read_all(back.as_ref()).unwrap(), "{name}: other voxels");
        let (old, new) = (before.survey.as_ref().unwrap(), after.survey.as_ref().unwrap());
        assert_eq!((old.inline, old.crossline), (new.inline, new.crossline), "{name}");
        assert_eq!((old.sample_interval, old.first_sample), (new.sample_interval, new.first_sample), "{name}");
        assert_eq!(before.axes[2], after.axes[2], "{name}");
        let [a, b] = [before, after].map(|i| i.geometry);
        assert_eq!((a.direction, a.origin), (b.direction, b.origin), "{name}");
        assert!((0..3).all(|i| (a.spacing[i] / b.spacing[i] - 1.0).abs() < 1e-4), "{name}: {a:?} {b:?}");
        for (old, new) in old.corners.iter().flatten().zip(new.corners.iter().flatten()) {
            assert!((0..2).all(|i| (old[i] - new[i]).abs() < 0.05), "{name}: {old:?} {new:?}");
        }
        assert!(new.text_header.contains("INLINE AT BYTES 189-192"), "{}", new.text_header);
    }
}

/// For each voxel type, for a box, and for a coarser level, the headers are right.
#[test]
fn segy_of_boxes_levels_and_types() {
    let folder = tempfile::tempdir().unwrap();
    let output = folder.path().join("out.sgy");
    let part = VoxelBox { start: [2, 3, 4], end: [15, 17, 18] };
    for voxel_type in VoxelType::ALL {
        let container = built(folder.path(), voxel_type, |info| {
            info.geometry =
                Geometry { spacing: [12.5, 25.0, 0.3], origin: [1000.0, 2000.0, 40.0], ..Geometry::IDENTITY };
            info.axes = ["x", "y", "z"].map(|name| Axis { name: name.into(), unit: "m".into() });
        });
        for (lod, voxels) in [(0, None), (0, Some(part)), (1, None)] {
            let (whole, _) = extract(&container, &output, &extraction(lod, voxels)).unwrap();
            let back = open(&output, &OpenOptions::default()).unwrap_or_else(|e| panic!("{voxel_type}: {e}"));
            let mut expected = vec![0; whole.voxels() * voxel_type.bytes()];
            LevelReader::new(&container, Lod(lod), 0).read_box(whole, &mut expected).unwrap();
            assert_eq!((back.info().voxel_type, back.info().dims.full_box().extent()), (voxel_type, whole.extent()));
            assert!(read_all(back.as_ref()).unwrap() == expected, "{voxel_type}, level {lod}, {voxels:?}");
            let scale = container.pyramid().level_at(Lod(lod)).scale.map(|s| s as f64);
            let (geometry, survey) = (back.info().geometry, back.info().survey.clone().unwrap());
            let spacing = [12.5 * scale[0], 25.0 * scale[1], 0.3 * scale[2]];
            assert!((0..3).all(|a| (geometry.spacing[a] - spacing[a]).abs() < 1e-9), "{geometry:?}");
            let first = |a: usize| (whole.start[a] as f64 + 0.5) * scale[a] - 0.5;
            let corner = [1000.0 + 12.5 * first(0), 2000.0 + 25.0 * first(1)];
            assert_eq!(survey.corners.unwrap()[0], corner, "{voxel_type}");
            assert!((survey.first_sample - (40.0 + 0.3 * first(2))).abs() < 1e-9, "{}", survey.first_sample);
            assert_eq!(survey.crossline.first as u64, 1 + whole.start[0] * scale[0] as u64);
        }
    }
}

/// The smallest memory that the error names suffices; less does not.
#[test]
fn zarr_and_segy_in_little_memory() {
    let folder = tempfile::tempdir().unwrap();
    let container = built(folder.path(), VoxelType::F64, |_| ());
    for name in ["out.zarr", "out.sgy"] {
        let output = folder.path().join(name);
        let little = Extraction { memory_bytes: 1000, ..extraction(0, None) };
        let error = extract(&container, &output, &little).unwrap_err().to_string();
        assert!(error.contains("`memory_bytes`"), "{error}");
        assert!(!output.exists());
    }
}

/// A brick at a time or all of them, as stored or scaled: the same file.
#[test]
fn little_memory_changes_no_byte() {
    let folder = tempfile::tempdir().unwrap();
    for scale in [1.0, 0.5] {
        let container = built(folder.path(), VoxelType::U16, |info| info.scale = scale);
        for end in ["raw", "tif", "npy"] {
            for voxels in [None, Some(VoxelBox { start: [3, 15, 0], end: [19, 18, 17] })] {
                let [much, little] = ["much", "little"].map(|name| folder.path().join(format!("{name}.{end}")));
                extract(&container, &much, &extraction(0, voxels)).unwrap();
                let refused = extract(&container, &little, &Extraction { memory_bytes: 0, ..extraction(0, voxels) });
                let refused = refused.unwrap_err().to_string();
                let needed: u64 = refused.split(' ').next().unwrap().parse().unwrap();
                let least = Extraction { memory_bytes: needed << 20, ..extraction(0, voxels) };
                extract(&container, &little, &least).unwrap();
                assert!(std::fs::read(&much).unwrap() == std::fs::read(&little).unwrap(), "{end}, {scale}, {voxels:?}");
            }
        }
    }
}
