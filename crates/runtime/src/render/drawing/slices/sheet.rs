//! Colours of one slice, ray by ray: after the deadline from resident bricks, else chunk by chunk at full quality.

use glam::DVec3;
use rayon::prelude::*;
use supervol_format::cast::{narrow, single};
use supervol_scene::slices::filter::{FilterSpec, FilteredSlice, TexelGrid};
use supervol_scene::slices::{SliceColors, SlicePlane};

use super::cut::{Cut, Spans};
use super::sampling::{Chunk, Sampler};
use crate::render::error::RenderError;

/// Points sampled at a time.
const CHUNK_POINTS: usize = 1 << 16;

/// Colours of one slice, see the module.
#[derive(Default)]
pub struct Sheet {
    /// Colour of each ray of the slice's spans; NaN where there is no slice. `None` if none is known yet.
    pub colors: Option<Vec<[f32; 3]>>,
    /// Rows of rays whose colours are final.
    rows: usize,
    /// Final texels of a filtered slice, as far as they are known.
    texels: Vec<f32>,
    filtered: Option<FilteredSlice>,
    /// The chunk in progress.
    chunk: Chunk,
}

impl Sheet {
    /// Colours from resident bricks; none of them is final.
    ///
    /// # Errors
    /// As [`Sampler::advance`].
    pub fn of_what_is_there(cut: &Cut, slice: (usize, &Spans), sampler: &mut Sampler<'_>) -> Result<Self, RenderError> {
        let mut sheet = Self::default();
        sheet.advance(cut, slice, sampler)?;
        Ok(Self { colors: sheet.colors, ..Self::default() })
    }

    /// Samples the colours that are not final, until the deadline; returns whether all are final.
    ///
    /// # Errors
    /// As [`Sampler::advance`].
    pub fn advance(
        &mut self,
        cut: &Cut,
        slice: (usize, &Spans),
        sampler: &mut Sampler<'_>,
    ) -> Result<bool, RenderError> {
        Ok(self.sample_texels(cut, slice.0, sampler)? && self.sample_rays(cut, slice, sampler)?)
    }

    /// Samples texels of a slice with a filter, until the deadline; returns whether all are done.
    fn sample_texels(&mut self, cut: &Cut, number: usize, sampler: &mut Sampler<'_>) -> Result<bool, RenderError> {
        let slice = &cut.scene.slices[number];
        let Some(filter) = slice.filter.filter(|_| self.filtered.is_none()) else { return Ok(true) };
        let (geometry, scale) = sampler.grid();
        let grid = TexelGrid::new(slice, &geometry, cut.dims, &cut.scene.clip, scale);
        while self.texels.len() < grid.texels() {
            let run = self.texels.len()..(self.texels.len() + CHUNK_POINTS).min(grid.texels());
            let points: Vec<[f64; 3]> = grid.points(run).map(|p| cut.to_index.point(p)).collect();
            if !sampler.advance(&points, slice.interpolation, &mut self.chunk)? {
                return Ok(false);
            }
            self.texels.extend(std::mem::take(&mut self.chunk).values);
        }
        let texels = std::mem::take(&mut self.texels);
        self.filtered = Some(FilteredSlice::new(grid, texels, filter, sampler.map().shift));
        Ok(true)
    }

    /// Samples colours of rays, until the deadline; returns whether all are done.
    fn sample_rays(
        &mut self,
        cut: &Cut,
        (number, spans): (usize, &Spans),
        sampler: &mut Sampler<'_>,
    ) -> Result<bool, RenderError> {
        let slice = &cut.scene.slices[number];
        let [width, height] = cut.rays_size().map(|n| n as usize);
        let shown = self.colors.get_or_insert_with(|| vec![[f32::NAN; 3]; spans.rays()]);
        let filtered = self.filtered.as_ref().zip(slice.filter);
        let colors = colors_of(slice, filtered);
        while self.rows < height {
            let rows = (CHUNK_POINTS / width).max(1).min(height - self.rows);
            let rows = self.rows..self.rows + rows;
            let at = |y: usize| {
                spans.row(y).filter_map(move |x| {
                    let y = narrow::<u32>(y);
                    Some((spans.at(x, y)?, cut.point_on(number, x, y)?))
                })
            };
            let points: Vec<(usize, DVec3)> = rows.clone().into_par_iter().flat_map_iter(at).collect();
            let values: Vec<f64> = match filtered {
                Some((made, _)) => points.par_iter().map(|(_, p)| made.value(*p, slice.interpolation)).collect(),
                None => {
                    let at: Vec<[f64; 3]> = points.iter().map(|(_, p)| cut.to_index.point(*p)).collect();
                    if !sampler.advance(&at, slice.interpolation, &mut self.chunk)? {
                        return Ok(false);
                    }
                    let values = std::mem::take(&mut self.chunk).values;
                    values.into_iter().map(|value| sampler.map().to_data(value)).collect()
                }
            };
            shown[spans.of_rows(rows.clone())].fill([f32::NAN; 3]);
            for ((ray, _), value) in points.iter().zip(values).filter(|(_, value)| !value.is_nan()) {
                if let Some(color) = colors.color(value) {
                    shown[*ray] = color.map(single);
                }
            }
            self.rows = rows.end;
        }
        Ok(true)
    }
}

/// The colours of a slice: its own, or those that suit its filter.
fn colors_of(slice: &SlicePlane, filtered: Option<(&FilteredSlice, FilterSpec)>) -> SliceColors {
    let by_filter = || filtered.map(|(made, filter)| SliceColors::Values(made.colors(filter.kind)));
    slice.colors.clone().or_else(by_filter).expect("a slice without a filter has colours")
}
