//! The description of a picture that all ray casters on the CPU share.

use std::ops::Range;

use glam::{DMat3, DVec3};
use supervol_format::cast::{narrow, single};
use supervol_format::{Dims, Geometry, Lod, Pyramid, ValueRange};
use supervol_scene::camera::{Camera, Ray};
use supervol_scene::clip::{Clip, IndexRay, Segment, clip_parts};
use supervol_scene::image::Image;
use supervol_scene::scene::{IsoSpec, Mode, ResolvedScene};
use supervol_scene::transfer_function::{RenderTransferFunction, TransferFunction};
use supervol_scene::value_map::ValueMap;

use super::cells::bounded::Modulation;
use super::cells::shade::Lighting;
use super::ray::{RayState, pixel_of_light};
use super::rules::TERMINATION_OPACITY;
use crate::lod::{LodChoice, LodRule};
use crate::stream::classify::Skipping;
use crate::stream::field::Field;

/// One iso surface in render values.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct IsoSurface {
    /// Render value.
    pub value: f32,
    /// Colour.
    pub color: [f32; 3],
    /// Opacity.
    pub alpha: f32,
}

/// A volume as ray casters see it: its levels, its place in the world, its values.
#[derive(Debug, Clone, Copy)]
pub struct DrawnVolume<'a> {
    /// Levels and bricks.
    pub pyramid: &'a Pyramid,
    /// Index space of level 0 in the world.
    pub geometry: &'a Geometry,
    /// Stored numbers to render values.
    pub map: ValueMap,
    /// Range of the whole volume, data units.
    pub value_range: ValueRange,
}

/// Bricks that rays take, and those that they leave out.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BrickChoice {
    /// Level of each brick.
    pub lod: LodChoice,
    /// Whether invisible bricks and macro cells are skipped.
    pub skipping: Skipping,
}

/// Data of a picture that is the same for all its rays and all casters.
#[derive(Debug, Clone)]
pub struct RayScene {
    /// The drawn field; it is part of the keys of data derived from bricks.
    pub(crate) field: Field,
    pub(crate) pyramid: Pyramid,
    pub(crate) geometry: Geometry,
    pub(crate) camera: Camera,
    pub(crate) subgrid: u32,
    /// Rows of rays that are cast; the whole picture unless [`RayScene::band`] says otherwise.
    pub(crate) rows: Range<u32>,
    pub(crate) clip: Clip,
    pub(crate) mode: Mode,
    pub(crate) transfer_function: RenderTransferFunction,
    /// The same over data values, in `f64`.
    pub(crate) data_transfer_function: TransferFunction,
    pub(crate) lighting: Option<Lighting>,
    /// Extinction and light of cells that are integrated in `f64`; opacity by the gradient and normals of cuts in mode `dvr` alone.
    pub(crate) modulation: Modulation,
    pub(crate) iso: Vec<IsoSurface>,
    /// Whether crossings are listed, all of them, and not composited.
    pub(crate) lists_crossings: bool,
    pub(crate) map: ValueMap,
    pub(crate) lod: LodRule,
    /// The level at which the search for a brick begins.
    pub(crate) first_lod: Lod,
    pub(crate) skipping: Skipping,
    /// Opacity at which a ray ends in mode `dvr`.
    pub(crate) termination_opacity: f64,
}

impl RayScene {
    /// The picture of a scene over one volume; rays end at this opacity in mode `dvr`.
    #[must_use]
    pub fn new(scene: &ResolvedScene, volume: &DrawnVolume<'_>, bricks: BrickChoice, termination_opacity: f64) -> Self {
        let DrawnVolume { pyramid, geometry, map, value_range } = *volume;
        let coarsest = pyramid.coarsest();
        let first_lod = match bricks.lod {
            LodChoice::Fixed(lod) => lod.min(coarsest),
            LodChoice::Auto { .. } => coarsest,
        };
        let surface = |s: &IsoSpec| IsoSurface {
            value: map.from_data(s.value),
            color: s.color.map(single),
            alpha: single(s.alpha),
        };
        // Surfaces are drawn apart from the volume around them.
        let volume_only = scene.transfer_function.without_surfaces();
        let is_dvr = scene.mode == Mode::Dvr;
        let ramp = scene.gradient_opacity.filter(|_| is_dvr);
        let cuts = scene.cut_normals.as_ref().filter(|_| is_dvr && scene.shading.is_some());
        Self {
            field: Field::FIRST,
            pyramid: pyramid.clone(),
            geometry: *geometry,
            camera: scene.camera,
            subgrid: scene.subgrid,
            rows: 0..scene.camera.height,
            clip: scene.clip.clone(),
            mode: scene.mode,
            transfer_function: RenderTransferFunction::new(&volume_only, map.shift),
            modulation: Modulation::new(ramp, cuts, &volume_only),
            data_transfer_function: volume_only,
            lighting: scene.shading.as_ref().map(|s| Lighting::new(s, geometry, value_range.width())),
            iso: scene.iso.iter().map(surface).collect(),
            lists_crossings: false,
            map,
            lod: LodRule::new(bricks.lod, &scene.camera, geometry),
            first_lod,
            skipping: bricks.skipping,
            termination_opacity,
        }
    }

    /// The same for some rows of pixels only, numbered from the top: its picture is that band of the picture.
    ///
    /// # Panics
    /// If the picture has no such rows.
    #[must_use]
    pub fn band(&self, pixel_rows: Range<u32>) -> Self {
        let rows = pixel_rows.start * self.subgrid..pixel_rows.end * self.subgrid;
        assert!(rows.end <= self.camera.height, "pixel rows {pixel_rows:?} of {} rows of rays", self.camera.height);
        Self { rows, ..self.clone() }
    }

    /// Rays of the picture's rows.
    #[must_use]
    pub fn ray_count(&self) -> u64 {
        u64::from(self.camera.width) * self.rows.len() as u64
    }

    /// The picture of these rays, row by row from the top, sub-grid averaged.
    pub(crate) fn image_of(&self, pixels: Vec<[f32; 4]>) -> Image {
        Image { width: self.camera.width, height: narrow::<u32>(self.rows.len()), pixels }.downsampled(self.subgrid)
    }

    /// The pixel of a ray with this state.
    pub(crate) fn pixel(&self, state: &RayState) -> [f32; 4] {
        let value = match self.mode {
            Mode::Dvr | Mode::Iso | Mode::Slice => {
                return pixel_of_light(state.color, state.transmittance);
            }
            Mode::Mip | Mode::Minip => state.value,
            Mode::Mean => state.value / state.length,
        };
        if value.is_nan() {
            return [0.0; 4];
        }
        let ([r, g, b], alpha) = self.data_transfer_function.classify(value + self.map.shift);
        [r * alpha, g * alpha, b * alpha, alpha].map(single)
    }

    /// Whether the rest of the ray can change the picture by less than its allowed error.
    #[inline]
    pub(crate) fn is_done(&self, state: &RayState) -> bool {
        match self.mode {
            Mode::Dvr => state.transmittance <= 1.0 - self.termination_opacity,
            Mode::Iso if self.lists_crossings => false,
            Mode::Iso => {
                let all_hit = state.iso.hit.count_ones() as usize == self.iso.len();
                state.transmittance <= 1.0 - TERMINATION_OPACITY || all_hit
            }
            Mode::Mip | Mode::Minip | Mode::Mean | Mode::Slice => false,
        }
    }

    /// Column and row, from the top left of the whole picture, of the frame's `ray`th ray; of rays, not of pixels of a
    /// supersampled picture.
    #[inline]
    pub(crate) fn pixel_of(&self, ray: usize) -> [u32; 2] {
        let width = self.camera.width as usize;
        [narrow::<u32>(ray % width), self.rows.start + narrow::<u32>(ray / width)]
    }

    /// World gradient from central differences at a level.
    pub(crate) fn world_from_level_gradient(&self, lod: Lod) -> DMat3 {
        let scale = DVec3::from_array(self.pyramid.level_at(lod).scale.map(|s| s as f64));
        self.geometry.world_from_index_gradient() * DMat3::from_diagonal(1.0 / scale)
    }

    /// Whether rays gather light, and not values.
    pub(crate) fn has_transmittance(&self) -> bool {
        matches!(self.mode, Mode::Dvr | Mode::Iso | Mode::Slice)
    }

    /// Voxels of level 0 along each axis.
    pub(crate) fn finest_dims(&self) -> Dims {
        self.pyramid.level_at(Lod::FINEST).dims
    }

    /// Whether rays may be drawn in several parts.
    pub(crate) fn cuts_rays(&self) -> bool {
        !self.clip.solids.is_empty()
    }

    /// The parts of a ray that are drawn, front to back.
    pub(crate) fn parts_of(&self, ray: &Ray, index_ray: &IndexRay) -> Vec<Segment> {
        clip_parts(ray, index_ray, self.finest_dims(), &self.clip)
    }
}
