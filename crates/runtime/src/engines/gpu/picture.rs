//! One picture on a device: tables that its scene fixes, and the pixels of what its rays have gathered.

use rayon::prelude::*;
use supervol_format::{Lod, Pyramid};
use supervol_scene::image::Image;
use supervol_scene::scene::{Mode, ResolvedScene};
use supervol_scene::transfer_function::{RenderTransferFunction, TransferFunction};

use super::options::GpuOptions;
use super::pass::Capacity;
use super::pixels::DeviceRay;
use super::ray_parts::RayParts;
use super::rays::RayGrid;
use super::scene_tables::{Exactness, GpuVolume};
use crate::engines::gpu::error::GpuError;
use crate::engines::gpu::piece_table::PieceTable;
use crate::engines::rules::{BESIDE_SURFACES, MAX_ERROR_LIMITS};
use crate::lod::{LodChoice, LodRule};

/// Data of one picture.
#[derive(Debug)]
pub struct Picture {
    pub(crate) mode: Mode,
    pub(crate) subgrid: u32,
    pub(super) size: [u32; 2],
    /// Source of the next two, together with `shift` and the requested error; another picture may have the same.
    transfer_function: TransferFunction,
    pub(crate) tf: RenderTransferFunction,
    pub(crate) light: PieceTable,
    pub(crate) exactness: Exactness,
    /// Required level of a brick by its distance.
    pub(super) lod: LodRule,
    /// For each entry from level 1 on, in order: whether the brick is too coarse.
    pub(super) refine: Vec<bool>,
    /// Entries that are drawn from their parents.
    pub(super) failed: Vec<u32>,
    /// Parts of rays that solids leave; `None` without solids.
    pub(super) parts: Option<RayParts>,
    /// Number that is subtracted from every data value.
    pub(crate) shift: f64,
    /// Whether render values are rounded.
    pub(super) is_rounded: bool,
    /// Whether there are surfaces inside the volume.
    pub(crate) has_surfaces: bool,
}

impl Picture {
    pub(super) fn new(
        volume: &GpuVolume<'_>,
        scene: &ResolvedScene,
        lod: LodChoice,
        (options, sums_errors): (&GpuOptions, bool),
        before: Option<&Self>,
    ) -> Self {
        let [least, most] = MAX_ERROR_LIMITS;
        let share = if scene.has_inner_surfaces() { BESIDE_SURFACES } else { 1.0 };
        let max_error = (share * options.max_error).clamp(least, most);
        let shift = volume.value_map.shift;
        let lod = LodRule::new(lod, &scene.camera, volume.geometry);
        let transfer_function = scene.transfer_function.without_surfaces();
        let is_the_same = |it: &&Self| {
            it.transfer_function == transfer_function && it.exactness.max_error == max_error && it.shift == shift
        };
        let (tf, light) = match before.filter(is_the_same) {
            Some(before) => (before.tf.clone(), before.light.clone()),
            None => (
                RenderTransferFunction::new(&transfer_function, shift),
                PieceTable::new(&transfer_function, shift, max_error),
            ),
        };
        Self {
            mode: scene.mode,
            subgrid: scene.subgrid,
            size: [scene.camera.width, scene.camera.height],
            tf,
            light,
            transfer_function,
            exactness: Exactness { skipping: options.skipping, max_error, sums_errors },
            refine: bricks_to_refine(volume.pyramid, &lod),
            lod,
            failed: Vec::new(),
            parts: RayParts::new(
                &scene.camera,
                volume.geometry,
                volume.pyramid.level_at(Lod::FINEST).dims,
                &scene.clip,
            ),
            shift,
            is_rounded: volume.value_map.is_rounded,
            has_surfaces: scene.has_inner_surfaces(),
        }
    }

    /// Required capacity, with or without summed errors.
    pub(super) fn capacity(&self, entries: u64, sums_errors: bool) -> Capacity {
        let [width, height] = self.size;
        Capacity::new((RayGrid { width, height }, self.subgrid), (&self.tf, &self.light), entries, sums_errors)
    }

    /// The same with room for larger pictures to come.
    pub(super) fn capacity_with_room(&self, entries: u64, options: &GpuOptions) -> Capacity {
        let own = self.capacity(entries, options.sums_errors);
        options.room.map_or(own, |[width, height]| {
            let grid = RayGrid { width, height };
            own.with_rays_of(&Capacity::new((grid, 1), (&self.tf, &self.light), entries, options.sums_errors))
        })
    }
}

/// Fewest pixels that are worth a thread.
pub const PIXELS_TOGETHER: usize = 1 << 12;

/// Calls `write` with memory for the rays of a grid, row by row, and writes their means per pixel to `to`. If a pixel is one
/// ray, `write` gets `to` itself.
///
/// # Errors
/// Those of `write`.
pub fn over_rays<T>(
    RayGrid { width, height }: RayGrid,
    subgrid: u32,
    to: &mut [[f32; 4]],
    write: impl FnOnce(&mut [[f32; 4]]) -> Result<T, GpuError>,
) -> Result<T, GpuError> {
    if subgrid == 1 {
        return write(to);
    }
    let mut rays = Image { width, height, pixels: vec![[0.0; 4]; width as usize * height as usize] };
    let result = write(&mut rays.pixels)?;
    to.copy_from_slice(&rays.downsampled(subgrid).pixels);
    Ok(result)
}

/// The pixel of what one ray has gathered; twin of the CPU frame's.
pub fn pixel(mode: Mode, tf: &RenderTransferFunction, gathered: &DeviceRay) -> [f32; 4] {
    let value = match (mode, *gathered) {
        (Mode::Dvr | Mode::Iso | Mode::Slice, [r, g, b, transmittance]) => return [r, g, b, 1.0 - transmittance],
        (_, [_, present, ..]) if present <= 0.0 => return [0.0; 4],
        (Mode::Mip | Mode::Minip, [extreme, ..]) => extreme,
        (Mode::Mean, [integral, present, ..]) => integral / present,
    };
    let [r, g, b, alpha] = tf.classify(value);
    [r * alpha, g * alpha, b * alpha, alpha]
}

/// For each entry from level 1 on: whether the brick is too coarse. `f64` and in one place: both backends agree.
fn bricks_to_refine(pyramid: &Pyramid, lod: &LodRule) -> Vec<bool> {
    let first = pyramid.level_at(Lod::FINEST).brick_count();
    (first..pyramid.brick_count())
        .into_par_iter()
        .map(|entry| !lod.is_fine_enough(pyramid, pyramid.key(entry).expect("entries below the count have keys")))
        .collect()
}
