//! What the table of contents alone says about a brick: absent, invisible, uniform, or to be read.
//!
//! The range in the TOC bounds everything that interpolation reaches. In `dvr`, a brick on whose range the transfer
//! function is transparent is *invisible*: its macro cells are so too, and leaving it out changes no picture. In `iso`, a
//! ray must know on which side of the iso values it is: a brick without holes whose range holds no iso value is answered
//! as uniform, with a value on its side. `mip`, `minip` and `mean` must see every present value.

use supervol_format::VoxelType;
use supervol_format::container::toc::BrickEntry;

use super::state::Emptiness;
use crate::raycast::cpu::Skipping;
use crate::raycast::volume::ValueMap;
use crate::scene::{Mode, ResolvedScene};
use crate::transfer_function::RenderTransferFunction;

/// What must be done for a brick.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Class {
    /// Nothing of it can be seen.
    Nothing(Emptiness),
    /// It has this render value everywhere.
    Uniform(f32),
    /// It must be read and decoded.
    Load,
}

/// Classification of bricks for one scene.
#[derive(Debug)]
pub struct Classifier {
    voxel_type: VoxelType,
    map: ValueMap,
    visibility: Visibility,
}

#[derive(Debug)]
enum Visibility {
    /// Every present value is seen.
    All,
    /// What has positive opacity is seen.
    Classified(Box<RenderTransferFunction>),
    /// Ranges that hold one of these render values are seen.
    Iso(Vec<f32>),
}

impl Classifier {
    /// Classification for a scene over a container with this voxel type and value map.
    #[must_use]
    pub fn new(scene: &ResolvedScene, voxel_type: VoxelType, map: ValueMap, skipping: Skipping) -> Self {
        let visibility = match (skipping, scene.mode) {
            (Skipping::On, Mode::Dvr) => {
                Visibility::Classified(Box::new(RenderTransferFunction::new(&scene.transfer_function, map.shift)))
            }
            (Skipping::On, Mode::Iso) => Visibility::Iso(scene.iso.iter().map(|i| map.from_data(i.value)).collect()),
            _ => Visibility::All,
        };
        Self { voxel_type, map, visibility }
    }

    /// What must be done for the brick of this entry.
    #[must_use]
    pub fn classify(&self, entry: &BrickEntry) -> Class {
        if entry.absent {
            return Class::Nothing(Emptiness::Absent);
        }
        let ends = [entry.range.min, entry.range.max].map(|v| self.map.from_container(self.voxel_type, v));
        let (low, high) = (ends[0].min(ends[1]), ends[0].max(ends[1]));
        match &self.visibility {
            Visibility::Classified(function) if !function.is_visible(low, high) => Class::Nothing(Emptiness::Invisible),
            Visibility::Iso(values) if !entry.has_holes && !values.iter().any(|v| (low..=high).contains(v)) => {
                Class::Uniform(low)
            }
            _ if entry.uniform => Class::Uniform(low),
            _ => Class::Load,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{DataKind, Scene, VolumeFacts};
    use supervol_format::codec::Codec;
    use supervol_format::{Dims, Geometry, ValueRange};

    fn classifier(json: &str, skipping: Skipping) -> Classifier {
        let value_range = ValueRange { min: 0.0, max: 255.0 };
        let facts = VolumeFacts {
            dims: Dims([16; 3]),
            geometry: Geometry::IDENTITY,
            value_range,
            percentiles: vec![],
            kind: DataKind::Generic,
            has_zero_centre: false,
        };
        let scene = Scene::from_json(json).unwrap().resolve(&facts).unwrap();
        let map = ValueMap::for_container(VoxelType::U8, -1.0, 255.0, None, value_range);
        Classifier::new(&scene, VoxelType::U8, map, skipping)
    }

    fn entry(min: f64, max: f64) -> BrickEntry {
        let range = ValueRange { min, max };
        BrickEntry {
            offset: 4096,
            payload_bytes: 1,
            macro_cell_bytes: 2,
            codec: Codec::Raw,
            absent: range.is_empty(),
            uniform: min == max,
            has_holes: false,
            checksum: 0,
            fill: 0,
            range,
            range_beneath: range,
            error: 0.0,
        }
    }

    #[test]
    fn only_modes_that_cannot_see_a_value_leave_it_out() {
        // Data value = 255 - stored value; visible above 200, which are stored values below 55.
        let points = r#""transfer_function": {"points": [{"value": 200, "color": [1,1,1], "alpha": 0},
            {"value": 255, "color": [1,1,1], "alpha": 1}]}"#;
        let invisible = Class::Nothing(Emptiness::Invisible);
        let dvr = classifier(&format!("{{{points}}}"), Skipping::On);
        assert_eq!(dvr.classify(&entry(60.0, 250.0)), invisible);
        assert_eq!(dvr.classify(&entry(50.0, 250.0)), Class::Load);
        assert_eq!(dvr.classify(&entry(60.0, 60.0)), invisible);
        assert_eq!(dvr.classify(&entry(5.0, 5.0)), Class::Uniform(250.0));
        assert_eq!(classifier(&format!("{{{points}}}"), Skipping::Off).classify(&entry(60.0, 250.0)), Class::Load);
        let iso = classifier(r#"{"mode": "iso", "iso": [{"value": 100, "color": [1,1,1]}]}"#, Skipping::On);
        assert_eq!(iso.classify(&entry(156.0, 250.0)), Class::Uniform(5.0));
        assert_eq!(iso.classify(&entry(155.0, 250.0)), Class::Load);
        assert_eq!(iso.classify(&BrickEntry { has_holes: true, ..entry(156.0, 250.0) }), Class::Load);
        for mode in ["mip", "minip", "mean"] {
            let all = classifier(&format!("{{\"mode\": \"{mode}\", {points}}}"), Skipping::On);
            assert_eq!(all.classify(&entry(60.0, 250.0)), Class::Load, "{mode}");
            let absent = entry(f64::INFINITY, f64::NEG_INFINITY);
            assert_eq!(all.classify(&absent), Class::Nothing(Emptiness::Absent), "{mode}");
        }
    }
}
