//! A scene and a volume in the form that shaders read: [`Config`], [`Tables`], and the transfer function's buffers.

use bytemuck::Zeroable;
use supervol_format::brick::APRON;
use supervol_format::cast::{narrow, single};
use supervol_format::{Geometry, Pyramid, ValueRange};
use supervol_scene::scene::{Mode, ResolvedScene};
use supervol_scene::transfer_function::{ALPHA_LIMIT, RenderTransferFunction};
use supervol_scene::value_map::ValueMap;

use super::feedback::{MISS_LIMIT, miss_words, tile_words, wait_words};
use super::layout::{
    Config, FLAG_ABSENT, FLAG_BYTES, FLAG_ERRORS, FLAG_FLOAT, FLAG_HOLES, FLAG_LIGHT, FLAG_SHADED, FLAG_SKIPPING,
    FLAG_SURFACES, GpuIso, GpuLevel, GpuLight, GpuPoint, MODE_DVR, MODE_ISO, MODE_MEAN, MODE_MINIP, MODE_MIP, SlotGrid,
    Tables,
};
use super::piece_table::PieceTable;
use crate::engines::cells::shade::Lighting;
use crate::engines::gpu::error::GpuError;
use crate::engines::gpu::texels::VoxelStorage;
use crate::engines::packets::highlight::Highlight;
use crate::engines::packets::shade::whole_half_of;
use crate::engines::rules::{
    BY_OPACITY, END_SHARE, LEAST_SHADED_SHARE, PAIR_ERROR, TERMINATION_OPACITY, aimed_error, reserve,
};
use crate::stream::classify::Skipping;

/// The volume that a renderer draws.
#[derive(Debug, Clone, Copy)]
pub struct GpuVolume<'a> {
    /// Its levels.
    pub pyramid: &'a Pyramid,
    /// Its place in the world.
    pub geometry: &'a Geometry,
    /// Map from stored numbers to render values.
    pub value_map: &'a ValueMap,
    /// Range of all present values, data units.
    pub value_range: ValueRange,
    /// Storage of its decoded bricks.
    pub storage: VoxelStorage,
}

/// Accuracy of the integration, and permitted omissions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Exactness {
    /// Whether macro cells that cannot change the picture are skipped.
    pub skipping: Skipping,
    /// Requested error of any channel of any pixel, 1 is white.
    pub max_error: f64,
    /// Whether errors of rays are summed up.
    pub sums_errors: bool,
}

/// Facts of the device's memory that the tables need.
#[derive(Debug, Clone, Copy)]
pub struct FeedbackPlaces {
    /// Position of slots.
    pub grids: [SlotGrid; 4],
    /// Number of slots.
    pub slots: u64,
    /// Entries of the page table.
    pub entries: u64,
}

/// The configuration of scene and volume. [`Config::stride`] is that of the view, [`Config::work_limit`] the adapter's.
///
/// # Errors
/// [`GpuError::Scene`] for a mode that this backend does not draw, for opacity by the gradient and for normals of cuts.
pub fn config(
    volume: &GpuVolume<'_>,
    scene: &ResolvedScene,
    tf: &RenderTransferFunction,
    light: &PieceTable,
    options: Exactness,
    places: FeedbackPlaces,
) -> Result<Config, GpuError> {
    check_available(scene)?;
    let core = volume.pyramid.layout().core();
    let Exactness { skipping, max_error, sums_errors } = options;
    let [light_centre, light_scale, light_offset] = light.values_of_stored(volume.storage, volume.value_map);
    let limits = light.limits();
    let (world, map) = (volume.geometry.linear(), volume.value_map);
    let lighting = scene.shading.as_ref().map(|s| Lighting::new(s, volume.geometry, volume.value_range.width()));
    let gradient = volume.geometry.world_from_index_gradient();
    let column = |c: glam::DVec3| c.as_vec3().to_array();
    let has_holes = volume.storage == VoxelStorage::F32 || map.absent.is_some();
    let flags = [
        (volume.storage == VoxelStorage::F32, FLAG_FLOAT),
        (volume.storage == VoxelStorage::U8, FLAG_BYTES),
        (map.absent.is_some() && volume.storage != VoxelStorage::F32, FLAG_ABSENT),
        (lighting.is_some(), FLAG_SHADED),
        (skipping == Skipping::On, FLAG_SKIPPING),
        (has_holes, FLAG_HOLES),
        (scene.mode == Mode::Dvr && light.is_resolved, FLAG_LIGHT),
        (scene.mode == Mode::Iso || scene.has_inner_surfaces(), FLAG_SURFACES),
        (sums_errors, FLAG_ERRORS),
    ];
    let config = Config {
        world_x: column(world.x_axis),
        world_y: column(world.y_axis),
        world_z: column(world.z_axis),
        mode: mode_number(scene.mode)?,
        flags: flags.iter().filter(|(on, _)| *on).map(|(_, flag)| flag).sum(),
        level_count: narrow::<u32>(volume.pyramid.levels().len()),
        gradient_x: column(gradient.x_axis),
        gradient_y: column(gradient.y_axis),
        gradient_z: column(gradient.z_axis),
        iso_count: narrow::<u32>(scene.iso.len()),
        value_scale: map.scale,
        value_offset: map.offset,
        absent: map.absent.map_or(0, u32::from),
        core: narrow::<u32>(core),
        point_count: narrow::<u32>(tf.points.len()),
        bin_count: narrow::<u32>(tf.bins.len()),
        alpha_limit: single(ALPHA_LIMIT),
        bins_per_value: tf.bins_per_value,
        inverse_unit_distance: tf.inverse_unit_distance,
        transmittance_limit: match scene.mode {
            Mode::Dvr => single(END_SHARE * max_error),
            _ => single(1.0 - TERMINATION_OPACITY),
        },
        light_centre,
        light_scale,
        light_offset,
        by_opacity: single(BY_OPACITY * max_error),
        reserve: single(reserve(max_error, core)),
        first_piece: light.first_piece,
        search_step: light.search_step,
        narrow: limits.narrow,
        rounded_difference: limits.difference,
        greatest_bend: limits.bend,
        rounded_bends: limits.rounded[0],
        rounded_kinks: limits.rounded[1],
        // The error of a Gauss pair falls with the fourth power of its width.
        pair_share: single((PAIR_ERROR / aimed_error(max_error, core)).sqrt().sqrt()),
        miss_limit: MISS_LIMIT,
        visible_points: narrow::<u32>(tf.points.iter().filter(|p| p.rgba[3] > 0.0).count()),
        miss_words: narrow::<u32>(miss_words(places.slots)),
        wait_words: narrow::<u32>(wait_words(places.slots)),
        tile_words: narrow::<u32>(tile_words(places.slots, places.entries)),
        grids: places.grids,
        rounding: map.rounding_within(volume.value_range),
        ..lit(lighting.as_ref(), volume, max_error)
    };
    Ok(config)
}

/// Refuses what this backend does not draw.
fn check_available(scene: &ResolvedScene) -> Result<(), GpuError> {
    let absent = [
        (scene.gradient_opacity.is_some(), "opacity by the gradient"),
        (scene.cut_normals.is_some(), "light by the normals of cuts"),
    ];
    match absent.iter().find(|(is_asked, _)| *is_asked) {
        Some((_, what)) => Err(GpuError::Scene { reason: format!("{what} is not available") }),
        None => Ok(()),
    }
}

/// A configuration of which only the lighting is set, if there is any.
fn lit(lighting: Option<&Lighting>, volume: &GpuVolume<'_>, max_error: f64) -> Config {
    let Some(lighting) = lighting else { return Config::zeroed() };
    let gradient = volume.geometry.world_from_index_gradient();
    // A difference over two voxels counts by half, and two values are off. On coarser levels a voxel is longer.
    let per_value = single(gradient.x_axis.length() + gradient.y_axis.length() + gradient.z_axis.length());
    Config {
        ambient: lighting.ambient,
        diffuse: lighting.diffuse,
        specular: lighting.specular,
        shininess: lighting.shininess,
        gradient_floor: lighting.gradient_floor,
        light_count: narrow::<u32>(lighting.lights.len()),
        least_shaded: single(LEAST_SHADED_SHARE * max_error),
        whole_half: whole_half_of(lighting.shininess).unwrap_or(0),
        brackets: Highlight::new(lighting.shininess).greatest,
        light_sum: lighting.lights.iter().map(|light| light.1).sum(),
        gradient_noise: per_value * volume.value_map.rounding_within(volume.value_range),
        ..Config::zeroed()
    }
}

fn mode_number(mode: Mode) -> Result<u32, GpuError> {
    match mode {
        Mode::Dvr => Ok(MODE_DVR),
        Mode::Mip => Ok(MODE_MIP),
        Mode::Minip => Ok(MODE_MINIP),
        Mode::Mean => Ok(MODE_MEAN),
        Mode::Iso => Ok(MODE_ISO),
        Mode::Slice => Err(GpuError::Scene { reason: "mode `slice` is not available".to_owned() }),
    }
}

/// Levels, lights and iso surfaces.
///
/// # Errors
/// [`GpuError::TableLimit`] if the pyramid has more bricks than 32 bits count.
pub fn tables(volume: &GpuVolume<'_>, scene: &ResolvedScene) -> Result<Tables, GpuError> {
    let entries = volume.pyramid.brick_count();
    if u32::try_from(entries).is_err() {
        return Err(GpuError::TableLimit {
            what: "the page table".to_owned(),
            needed: entries.saturating_mul(8),
            limit: u64::from(u32::MAX) * 8,
            advice: "use larger bricks".to_owned(),
        });
    }
    let mut tables = Tables::zeroed();
    for (slot, level) in tables.levels.iter_mut().zip(volume.pyramid.levels()) {
        *slot = GpuLevel {
            bricks: level.bricks,
            first_entry: narrow::<u32>(level.first_entry),
            scale_log2: level.scale.map(u64::ilog2),
            padding: 0,
        };
    }
    for (slot, light) in tables.lights.iter_mut().zip(scene.shading.iter().flat_map(|s| &s.lights)) {
        *slot = GpuLight { to_light: light.to_light.as_vec3().to_array(), intensity: single(light.intensity) };
    }
    for (slot, iso) in tables.isos.iter_mut().zip(&scene.iso) {
        *slot = GpuIso {
            color: iso.color.map(single),
            alpha: single(iso.alpha),
            value: volume.value_map.from_data(iso.value),
            ..GpuIso::zeroed()
        };
    }
    Ok(tables)
}

/// The control points.
#[must_use]
pub fn points(tf: &RenderTransferFunction) -> Vec<GpuPoint> {
    let point = |p: &supervol_scene::transfer_function::render::RenderPoint| GpuPoint {
        rgba: p.rgba,
        delta: p.delta,
        value: p.value,
        inverse_width: p.inverse_width,
        variation_before: p.variation_before,
        variation: p.variation,
        visible_before: p.visible_before,
        knots_up_to: p.knots_up_to,
        padding_0: 0,
        padding_1: 0,
    };
    tf.points.iter().map(point).collect()
}

/// The bins, then the bits of the knots.
#[must_use]
pub fn transfer_index(tf: &RenderTransferFunction) -> Vec<u32> {
    tf.bins.iter().copied().chain(tf.knots.iter().map(|k| k.to_bits())).collect()
}

/// Voxels along each axis of a slot.
#[must_use]
pub fn slot_edge(pyramid: &Pyramid) -> u32 {
    narrow::<u32>(pyramid.layout().core() + 2 * APRON)
}
