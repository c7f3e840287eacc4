//! N5: folders with `attributes.json`, blocks with headers, axes with the fastest first, big-endian numbers.
//! <https://github.com/saalfeldlab/n5>
//!
//! Spacing and origin are read as written by N5-viewer, COSEM and `BigDataViewer`. Either `pixelResolution`, or
//! `resolution` and `units`, of an array or of the group above it, times `downsamplingFactors`. Or `transform` of an
//! array, whose axes are in C order.

use std::path::Path;

use serde::Deserialize;
use serde_json::Value;

use super::codecs::Codec;
use super::metadata::{Array, Keys, check_shape, number_named};
use super::ome::{ArrayAxis, unit_of};
use crate::grid::chunked::ArrayShape;
use crate::input::text::shortened;
use crate::{Endian, SourceError};

/// Contents of `attributes.json`, of a dataset or a group.
#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub(super) struct Attributes {
    dimensions: Option<Vec<u64>>,
    block_size: Vec<u64>,
    data_type: String,
    compression: Value,
    compression_type: Option<String>,
    axes: Vec<String>,
    units: Vec<String>,
    resolution: Vec<f64>,
    pixel_resolution: Option<PixelResolution>,
    downsampling_factors: Vec<f64>,
    transform: Option<Transform>,
}

#[derive(Debug, Deserialize)]
struct PixelResolution {
    dimensions: Vec<f64>,
    #[serde(default)]
    unit: String,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct Transform {
    axes: Vec<String>,
    scale: Vec<f64>,
    translate: Vec<f64>,
    units: Vec<String>,
}

impl Attributes {
    pub(super) fn is_array(&self) -> bool {
        self.dimensions.is_some()
    }

    pub(super) fn array(&self, path: &Path) -> Result<Array, SourceError> {
        let reversed = |sizes: &[u64]| sizes.iter().rev().copied().collect::<Vec<_>>();
        let (shape, chunk) = (reversed(self.dimensions.as_deref().unwrap_or_default()), reversed(&self.block_size));
        check_shape(path, &shape, &chunk)?;
        let advice = "write the dataset anew, with gzip, zstd or blosc";
        let unsupported = |what: String| SourceError::unsupported(path, what, advice);
        let Some(number) = number_named(&self.data_type) else {
            return Err(unsupported(format!("elements of type `{}`", shortened(&self.data_type))));
        };
        let kind = self.compression["type"].as_str().or(self.compression_type.as_deref()).unwrap_or("raw");
        let stages = match kind {
            "raw" => vec![],
            "gzip" if self.compression["useZlib"] == true => vec![Codec::Zlib],
            "gzip" => vec![Codec::Gzip],
            "zstd" => vec![Codec::Zstd],
            "blosc" => vec![Codec::Blosc],
            "lz4" => vec![Codec::Lz4Blocks],
            other => return Err(unsupported(format!("it is compressed by `{}`", shortened(other)))),
        };
        let stored = (0..shape.len()).collect();
        let shape = ArrayShape { shape, chunk, stored, endian: Endian::Big, fill: [0; 8] };
        let keys = Keys { prefix: false, separator: '/', is_reversed: true };
        Ok(Array { number, shape, keys, stages, sharding: None, has_block_headers: true })
    }

    /// The axes of a dataset in C order; `group` has the attributes of the folder above.
    pub(super) fn axes(&self, group: &Self) -> Vec<ArrayAxis> {
        let rank = self.dimensions.as_ref().map_or(0, Vec::len);
        if let Some(Transform { axes, scale, translate, units }) = &self.transform {
            let is_whole = [axes.len(), scale.len(), translate.len()].iter().all(|n| *n == rank);
            if is_whole {
                let axis = |i: usize| ArrayAxis {
                    unit: units.get(i).map_or_else(String::new, |unit| unit_of(unit)),
                    spacing: scale[i],
                    origin: translate[i],
                    ..ArrayAxis::named(&axes[i])
                };
                return (0..rank).map(axis).collect();
            }
        }
        let usual = ["x", "y", "z", "c", "t"];
        let either = |of: fn(&Self) -> usize| if of(self) > 0 { self } else { group };
        let names = &either(|a| a.axes.len()).axes;
        let pixels = self.pixel_resolution.as_ref().or(group.pixel_resolution.as_ref());
        let resolution = pixels.map_or(&either(|a| a.resolution.len()).resolution, |p| &p.dimensions);
        let units = &either(|a| a.units.len()).units;
        let axis = |i: usize| {
            let factor = self.downsampling_factors.get(i).copied().unwrap_or(1.0);
            let spacing = resolution.get(i).copied().unwrap_or(1.0);
            let unit = pixels.map(|p| &p.unit).or(units.get(i)).map_or_else(String::new, |unit| unit_of(unit));
            let name = names.get(i).map_or(*usual.get(i).unwrap_or(&""), String::as_str);
            // A coarse voxel lies at the centre of its fine ones.
            let origin = spacing * (factor - 1.0) / 2.0;
            ArrayAxis { unit, spacing: spacing * factor, origin, ..ArrayAxis::named(name) }
        };
        (0..rank).rev().map(axis).collect()
    }
}

/// Header of a block: elements along each axis, fastest first, and the offset of the data behind it.
///
/// # Errors
/// A description of the defect.
pub(super) fn split_block(block: &[u8], rank: usize) -> Result<(Vec<u64>, usize), String> {
    let u16_at = |at: usize| block.get(at..)?.first_chunk().map(|b| u16::from_be_bytes(*b));
    let u32_at = |at: usize| block.get(at..)?.first_chunk().map(|b| u32::from_be_bytes(*b));
    let (Some(mode), Some(axes)) = (u16_at(0), u16_at(2)) else { return Err("shorter than its header".into()) };
    if usize::from(axes) != rank {
        return Err(format!("{axes} axes, where {rank} were expected"));
    }
    let sizes: Option<Vec<u64>> = (0..rank).map(|i| u32_at(4 + 4 * i).map(u64::from)).collect();
    let sizes = sizes.ok_or("shorter than its header")?;
    match mode {
        0 => Ok((sizes, 4 + 4 * rank)),
        1 => Ok((sizes, 8 + 4 * rank)),
        other => Err(format!("a block of kind {other}, which is not read")),
    }
}
