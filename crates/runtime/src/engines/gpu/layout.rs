//! Every struct and constant that Rust and WGSL share, defined once.
//!
//! [`wgsl`] writes them as text; `shaders/shared/layout.wgsl` is that text, so that the shaders can be read and checked
//! as they are. Tests fail if the file and this module differ (`UPDATE_LAYOUT=1` rewrites it), or if a field sits
//! elsewhere in the compiled shader than in Rust. A `vec3` is always followed by a scalar: then both sides pack alike.

use bytemuck::{Pod, Zeroable};

use super::borrowed;
use crate::engines::gpu::texels::VoxelStorage;

/// A Rust type with a WGSL name.
trait WgslType {
    fn name() -> String;
}

macro_rules! wgsl_type {
    ($($rust:ty => $name:literal),* $(,)?) => {
        $(impl WgslType for $rust {
            fn name() -> String {
                $name.to_owned()
            }
        })*
    };
}

wgsl_type! {
    u32 => "u32", i32 => "i32", f32 => "f32",
    [u32; 2] => "vec2<u32>", [f32; 2] => "vec2<f32>",
    [u32; 3] => "vec3<u32>", [i32; 3] => "vec3<i32>", [f32; 3] => "vec3<f32>",
    [u32; 4] => "vec4<u32>", [f32; 4] => "vec4<f32>", [f32; 12] => "array<f32, 12>",
}

/// Text and field offsets of one shared struct.
#[derive(Debug)]
pub struct StructLayout {
    /// Name in Rust and in WGSL.
    pub name: &'static str,
    /// `struct ... { ... }`
    pub wgsl: String,
    /// Field names and offsets, bytes.
    pub fields: Vec<(&'static str, usize)>,
    /// Bytes of the whole.
    pub size: usize,
}

/// Defines the Rust struct and its [`StructLayout`] from one list of fields.
macro_rules! shared_struct {
    ($(#[doc = $doc:literal])+ $name:ident { $($(#[doc = $field_doc:literal])+ $field:ident: $ty:ty,)+ }) => {
        $(#[doc = $doc])+
        #[repr(C)]
        #[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
        pub struct $name {
            $($(#[doc = $field_doc])+ pub $field: $ty,)+
        }

        impl $name {
            fn layout() -> StructLayout {
                let mut wgsl = String::new();
                $(wgsl.push_str(&format!("//{}\n", $doc));)+
                wgsl.push_str(concat!("struct ", stringify!($name), " {\n"));
                $(
                    $(wgsl.push_str(&format!("    //{}\n", $field_doc));)+
                    wgsl.push_str(&format!("    {}: {},\n", stringify!($field), <$ty as WgslType>::name()));
                )+
                wgsl.push_str("}\n");
                StructLayout {
                    name: stringify!($name),
                    wgsl,
                    fields: vec![$((stringify!($field), std::mem::offset_of!($name, $field)),)+],
                    size: size_of::<$name>(),
                }
            }
        }
    };
}

/// Defines `u32` constants and their text.
macro_rules! shared_constants {
    ($($(#[doc = $doc:literal])+ $name:ident = $value:expr;)+) => {
        $($(#[doc = $doc])+ pub const $name: u32 = $value;)+

        fn constants_wgsl() -> String {
            let mut wgsl = String::new();
            $(
                $(wgsl.push_str(&format!("//{}\n", $doc));)+
                wgsl.push_str(&format!("const {}: u32 = {}u;\n", stringify!($name), $name));
            )+
            wgsl
        }
    };
}

wgsl_type! {
    [SlotGrid; 4] => "array<SlotGrid, 4>",
    [GpuLevel; 64] => "array<GpuLevel, 64>",
    [GpuLight; 16] => "array<GpuLight, 16>",
    [GpuIso; 32] => "array<GpuIso, 32>",
    Fixed => "Fixed", Affine => "Affine", [Affine; 3] => "array<Affine, 3>", [PlaneLine; 64] => "array<PlaneLine, 64>",
    Config => "Config", Tables => "Tables", View => "View", Dispatch => "Dispatch",
}

// The tables hold whatever a scene or a container may have.
const _: () = assert!(supervol_format::Lod::LIMIT == 64 && supervol_scene::scene::LIGHT_LIMIT == 16);
const _: () = assert!(supervol_scene::scene::ISO_LIMIT == 32 && super::limits::TEXTURE_LIMIT == 4);
const _: () = assert!(supervol_scene::scene::PLANE_LIMIT == 64);

shared_constants! {
    /// Texels of a row of a table.
    TABLE_WIDTH = 1024;
    /// Texels of a piece of the transfer function: gpu/piece_table.rs.
    PIECE_TEXELS = super::limits::PIECE_TEXELS;
    /// Rays of one workgroup: one tile of 8 x 8 pixels.
    WORKGROUP_RAYS = 64;
    /// The ray can continue at once: it stopped at the dispatch's limit.
    STATUS_ACTIVE = 0;
    /// The ray waits for a brick.
    STATUS_WAITING = 1;
    /// The ray is finished.
    STATUS_DONE = 2;
    /// The ray can continue at once, in the brick where it stopped: its base point stays.
    STATUS_INSIDE = 3;
    /// Some ray of a tile stopped at the dispatch's limit.
    LEFT_INTERRUPTED = 1;
    /// Some ray of a tile waits for a brick.
    LEFT_WAITING = 2;
    /// Page table: the brick is not resident.
    PAGE_MISSING = 0;
    /// Page table: nothing of the brick is visible.
    PAGE_NOTHING = 1;
    /// Page table: the brick has one value, whose bits are the payload.
    PAGE_UNIFORM = 2;
    /// Page table: the brick cannot be read; its parent is drawn.
    PAGE_FAILED = 3;
    /// Page table: the payload is the slot.
    PAGE_RESIDENT = 4;
    /// Page table: bits of the state.
    PAGE_STATE = 0xff;
    /// Page table: the brick is too coarse; look at its children.
    PAGE_REFINE = 0x100;
    /// Page table: first bit of the number of the brick's deviation.
    PAGE_DEVIATION_SHIFT = 9;
    /// Number of the deviation of exact bricks.
    DEVIATION_NONE = 0;
    /// Number of the deviation of unknown bricks.
    DEVIATION_UNKNOWN = 1;
    /// Mode of a ray.
    MODE_DVR = 0;
    /// See above.
    MODE_MIP = 1;
    /// See above.
    MODE_MINIP = 2;
    /// See above.
    MODE_MEAN = 3;
    /// See above.
    MODE_ISO = 4;
    /// Flag: texels are the bits of 32-bit floats.
    FLAG_FLOAT = 1;
    /// Flag: one stored value means absent.
    FLAG_ABSENT = 2;
    /// Flag: samples are shaded.
    FLAG_SHADED = 4;
    /// Flag: invisible macro cells are skipped.
    FLAG_SKIPPING = 8;
    /// Flag: voxels can be absent at all.
    FLAG_HOLES = 16;
    /// Flag: antiderivatives of the transfer function are used (light_walk.wgsl): mode dvr, without steps.
    FLAG_LIGHT = 32;
    /// Flag: there are iso surfaces, alone or inside the volume.
    FLAG_SURFACES = 64;
    /// Flag: voxels are bytes; a texel of a cache texture holds four rows of them (gpu/cache.rs).
    FLAG_BYTES = 128;
    /// Flag: errors of rays are summed up (errors.wgsl).
    FLAG_ERRORS = 256;
    /// Bytes: voxels from a texel to the next one, along x and y.
    STEP_OF_BYTES = VoxelStorage::U8.texel_step();
    /// 16-bit numbers: voxels from a texel to the next one along x.
    STEP_OF_HALVES = VoxelStorage::U16.texel_step();
    /// Floats: voxels from a texel to the next one along x.
    STEP_OF_FLOATS = VoxelStorage::F32.texel_step();
}

shared_struct! {
    /// Position of one cache texture's slots.
    SlotGrid {
        /// Slots along x, y, z.
        slots: [u32; 3],
        /// Number of the texture's first slot; slots of later textures are greater.
        first: u32,
    }
}

shared_struct! {
    /// One level of detail.
    GpuLevel {
        /// Bricks along x, y, z.
        bricks: [u32; 3],
        /// Page table entry of the level's first brick.
        first_entry: u32,
        /// Binary logarithm of the source voxels per voxel of this level, per axis.
        scale_log2: [u32; 3],
        /// Zero.
        padding: u32,
    }
}

shared_struct! {
    /// One directional light.
    GpuLight {
        /// Unit world vector from the sample to the light.
        to_light: [f32; 3],
        /// Factor of its diffuse and specular terms.
        intensity: f32,
    }
}

shared_struct! {
    /// One iso surface.
    GpuIso {
        /// Its own colour.
        color: [f32; 3],
        /// Its own opacity.
        alpha: f32,
        /// Render value.
        value: f32,
        /// Zero.
        padding_0: f32,
        /// Zero.
        padding_1: f32,
        /// Zero.
        padding_2: f32,
    }
}

shared_struct! {
    /// One control point of the transfer function and the segment to its right; twin of `RenderPoint`.
    GpuPoint {
        /// Red, green, blue, alpha at the point.
        rgba: [f32; 4],
        /// Change of each up to the next point; 0 for the last.
        delta: [f32; 4],
        /// Render value.
        value: f32,
        /// 1 / width of the segment; 0 for the last and for steps.
        inverse_width: f32,
        /// Variation gathered by all segments before this point.
        variation_before: f32,
        /// Variation of the segment.
        variation: f32,
        /// Number of points before this one whose alpha is positive.
        visible_before: u32,
        /// Number of knots with a value not greater than this point's.
        knots_up_to: u32,
        /// Zero.
        padding_0: u32,
        /// Zero.
        padding_1: u32,
    }
}

shared_struct! {
    /// Facts of scene and volume.
    Config {
        /// World offset of one voxel along x.
        world_x: [f32; 3],
        /// `MODE_...`
        mode: u32,
        /// World offset of one voxel along y.
        world_y: [f32; 3],
        /// `FLAG_...`
        flags: u32,
        /// World offset of one voxel along z.
        world_z: [f32; 3],
        /// Levels of detail.
        level_count: u32,
        /// First column of the matrix from index-space to world-space gradients.
        gradient_x: [f32; 3],
        /// Least length of a world-space gradient that is shaded, render values per world length.
        gradient_floor: f32,
        /// Second column of that matrix.
        gradient_y: [f32; 3],
        /// Lights.
        light_count: u32,
        /// Third column of that matrix.
        gradient_z: [f32; 3],
        /// Iso surfaces.
        iso_count: u32,
        /// Shading: ka.
        ambient: f32,
        /// Shading: kd.
        diffuse: f32,
        /// Shading: ks.
        specular: f32,
        /// Shading: exponent of the highlight.
        shininess: f32,
        /// Render value per stored step.
        value_scale: f32,
        /// Render value of stored 0.
        value_offset: f32,
        /// Stored bits that mean absent, if `FLAG_ABSENT`.
        absent: u32,
        /// Core voxels along each axis of a full brick.
        core: u32,
        /// Control points of the transfer function.
        point_count: u32,
        /// Bins over the control points' values: the first words of `transfer_index`; the knots follow.
        bin_count: u32,
        /// Greatest opacity that has an extinction of its own.
        alpha_limit: f32,
        /// Bins per render value.
        bins_per_value: f32,
        /// Inverse of the world length that opacities refer to.
        inverse_unit_distance: f32,
        /// A ray whose transmittance is lower is finished.
        transmittance_limit: f32,
        /// A stride along a ray, in its parameter: a power of two.
        stride: f32,
        /// Places in the miss list.
        miss_limit: u32,
        /// Control points with positive alpha.
        visible_points: u32,
        /// Loop iterations after which a ray stops at the next cell.
        work_limit: u32,
        /// First word of the list of misses, behind the bits of slots used.
        miss_words: u32,
        /// First word of the feedback that counts rays waiting for a brick.
        wait_words: u32,
        /// First word of the tiles of a run, behind the counts.
        tile_words: u32,
        /// Stored number from which values of the transfer function's pieces are counted, before it is scaled.
        light_centre: f32,
        /// Such values per stored step.
        light_scale: f32,
        /// The value of `light_centre`.
        light_offset: f32,
        /// Error that a cell may spend per opacity: see engines/packets/budget.rs.
        by_opacity: f32,
        /// Reserve of a ray, for cells that need more.
        reserve: f32,
        /// Texel of the first piece, behind those of the search.
        first_piece: u32,
        /// Pieces from one knot to the next in the first texel of the search: a power of 4.
        search_step: u32,
        /// Width of an interval of values below which the mean is that of its ends.
        narrow: f32,
        /// Bound on the error of a difference of antiderivatives.
        rounded_difference: f32,
        /// Greatest change of slope per value in any piece.
        greatest_bend: f32,
        /// Bounds on what roundings take from a difference of sums of bends.
        rounded_bends: f32,
        /// And of those at knots alone.
        rounded_kinks: f32,
        /// Opacity of a part, times the transmittance in front; parts below it are not shaded.
        least_shaded: f32,
        /// Intensity of all lights.
        light_sum: f32,
        /// Gauss pairs, relative to the number for half a grey level.
        pair_share: f32,
        /// Half the shininess, if it is an integer for which products are used; else 0.
        whole_half: u32,
        /// Bound on what render values are off by the data, because they are rounded.
        rounding: f32,
        /// Bound on the length that a world-space gradient is off by, for that reason.
        gradient_noise: f32,
        /// Zero.
        padding_0: u32,
        /// Greatest brackets of a highlight: see engines/packets/highlight.rs.
        brackets: [f32; 4],
        /// The cache textures.
        grids: [SlotGrid; 4],
    }
}

shared_struct! {
    /// Tables of fixed size.
    Tables {
        /// Finest first; `Config.level_count` of them count.
        levels: [GpuLevel; 64],
        /// `Config.light_count` of them count.
        lights: [GpuLight; 16],
        /// `Config.iso_count` of them count.
        isos: [GpuIso; 32],
    }
}

shared_struct! {
    /// A number in two's complement: `whole + high * 2^-32 + low * 2^-64`, the last two unsigned.
    Fixed {
        /// Rounded down.
        whole: i32,
        /// First 32 bits of the fraction.
        high: u32,
        /// The next 32 bits.
        low: u32,
    }
}

shared_struct! {
    /// A number that changes linearly from pixel to pixel: `base + x * per_x + y * per_y`.
    Affine {
        /// At pixel (0, 0).
        base: Fixed,
        /// From a pixel to the next one in its row.
        per_x: Fixed,
        /// From a row to the next one.
        per_y: Fixed,
    }
}

shared_struct! {
    /// The height of rays above a clip plane, approximately in voxels: parts below 0 are cut off.
    PlaneLine {
        /// Height at the ray's begin.
        origin: Affine,
        /// Change per stride.
        stride: Affine,
    }
}

shared_struct! {
    /// Rays of a picture, in the index space of level 0: `origin + n * stride`, where n counts strides.
    ///
    /// The parameter t of a ray is a world length for orthographic cameras, and a depth for perspective ones;
    /// `length_at` gives the length of one unit of it.
    View {
        /// `sqrt(1 + (u.x + x u.y)^2 + (u.z + y u.w)^2)` is the world length of one unit of t.
        length: [f32; 4],
        /// Least corner of the drawn part of the volume's domain: whole voxels.
        box_low: [i32; 3],
        /// Rays of the picture along x.
        width: u32,
        /// Greatest corner of the same: whole voxels.
        box_high: [i32; 3],
        /// Rays along y.
        height: u32,
        /// Rest to add to `box_low`.
        box_low_rest: [f32; 3],
        /// First row of the band in progress.
        first_row: u32,
        /// Rest to add to `box_high`.
        box_high_rest: [f32; 3],
        /// Tiles of 8 x 8 rays along x.
        tiles_x: u32,
        /// Places of rays in the band: 64 for each tile.
        places: u32,
        /// Clip planes.
        plane_count: u32,
        /// First value of every ray's accumulator, modes mip and minip.
        first_value: f32,
        /// 1 if the host provides the parts of rays (`RayPart`), else 0.
        in_parts: u32,
        /// Begin of rays: a plane in front of the volume, or the eye.
        origin: [Affine; 3],
        /// Index offset of one stride.
        stride: [Affine; 3],
        /// `plane_count` of them count.
        planes: [PlaneLine; 64],
        /// Zero: the size is a multiple of 16.
        padding_1: [u32; 2],
    }
}

shared_struct! {
    /// One dispatch: a run of tiles of rays, or of pixels.
    Dispatch {
        /// For a run of pixels: number of the first one in its band, row by row.
        first_pixel: u32,
        /// 0 in a pass's first round, in which waiting rays look again whether their brick has come; then 1.
        later_round: u32,
        /// Number of coarsest levels whose bricks are all too coarse: the search for a brick's level begins behind
        /// them.
        refined_levels: u32,
        /// Zero.
        padding: u32,
    }
}

shared_struct! {
    /// All tables of fixed size.
    Scene {
        /// Facts of scene and volume.
        config: Config,
        /// Tables.
        tables: Tables,
        /// Rays.
        view: View,
        /// The dispatch in progress.
        job: Dispatch,
    }
}

shared_struct! {
    /// State of a ray between dispatches: 64 bytes. Its path follows from its pixel and is not stored.
    RayState {
        /// Premultiplied colour. Modes mip and minip: the extreme so far in x; mode mean: the integral of the value.
        color: [f32; 3],
        /// Share of the light behind that still passes.
        transmittance: f32,
        /// Parameter beyond the strides taken.
        t: f32,
        /// Strides taken: the ray's base point lies that many strides behind its origin.
        strides: u32,
        /// Strides to the last base point.
        end_strides: u32,
        /// Parameter from there to the end of what is drawn.
        end_rest: f32,
        /// `STATUS_...`
        status: u32,
        /// Modes mip, minip, mean: world length over which the value was present; with surfaces: 1 where `sides` holds.
        present: f32,
        /// One bit for each surface, set if the value was not below the surface's.
        sides: u32,
        /// Mode iso: one bit for each surface that was crossed already: only first crossings count.
        crossed: u32,
        /// Mode dvr: rest of the reserve of the ray's budget of error.
        left: f32,
        /// Mode dvr: upper bound on the share of the light behind that still passes.
        weight: f32,
        /// Zero.
        padding_0: u32,
        /// Zero.
        padding_1: u32,
    }
}

shared_struct! {
    /// Errors of a ray so far; 1 is white. Infinity is `FAR` here.
    RayErrors {
        /// Mode dvr: sum over its cells.
        cells: f32,
        /// Modes dvr and iso: sum of the deviations of coarser bricks. Mode mean: that of values, times world lengths.
        /// Modes mip and minip: largest possible
        /// excess of the drawn value over the exact one.
        levels: f32,
        /// Modes dvr and iso: least sum plus transmittance over all places so far. Modes mip and minip: largest
        /// possible excess of the exact value over the drawn one.
        bound: f32,
        /// Mode dvr: largest possible excess of drawn optical depth in front.
        thinner: f32,
        /// 1 if a voxel may be present in one level and absent in another.
        presence_may_change: u32,
    }
}

shared_struct! {
    /// Deviation of a drawn brick from level 0: `lod::deviation::Deviation`. World lengths, render values; infinity is
    /// `FAR`.
    GpuDeviation {
        /// Mode dvr: error per length for each of `PER_OPACITY`.
        per_length: [f32; 12],
        /// Mode dvr: greatest difference of the drawn extinction above the exact one.
        thinner: f32,
        /// Greatest extinction, drawn or exact; `FAR` if a surface may lie beneath.
        kappa_max: f32,
        /// Largest difference of a value; `FAR` if a value may be present or absent.
        value: f32,
        /// Least exact value; above the greatest one if there is none.
        least: f32,
        /// Greatest exact value.
        greatest: f32,
        /// 1 if a voxel in the brick or beneath it may be absent.
        presence_may_change: u32,
    }
}

shared_struct! {
    /// A part of a ray, if solids divide rays; `RayState` describes the numbers.
    RayPart {
        /// Place of the ray; unused beyond the band's places.
        place: u32,
        /// Parameter beyond the strides to the base point.
        t: f32,
        /// Strides to the base point of its begin.
        strides: u32,
        /// Strides to the last base point.
        end_strides: u32,
        /// Parameter from there to its end.
        end_rest: f32,
    }
}

shared_struct! {
    /// Counters of one dispatch, read back after it.
    GpuCounters {
        /// Rays that stopped at the work limit.
        interrupted: u32,
        /// Rays that wait for a brick.
        waiting: u32,
        /// Rays that finished in this dispatch.
        finished: u32,
        /// Trilinear cells integrated.
        cells: u32,
        /// Points at which the transfer function was evaluated.
        samples: u32,
        /// Macro cells entered.
        macro_cells: u32,
        /// Macro cells skipped.
        macro_cells_skipped: u32,
        /// Bricks entered.
        bricks: u32,
        /// Bricks drawn from an ancestor because they have failed.
        fallbacks: u32,
        /// Bricks left out because they and all their ancestors have failed.
        lost: u32,
        /// Times a loop hit its limit: such a ray is not exact.
        anomalies: u32,
        /// Zero.
        padding: u32,
    }
}

/// Every shared struct, in the order in which WGSL must see them.
#[must_use]
pub fn structs() -> Vec<StructLayout> {
    vec![
        SlotGrid::layout(),
        GpuLevel::layout(),
        GpuLight::layout(),
        GpuIso::layout(),
        GpuPoint::layout(),
        Config::layout(),
        Tables::layout(),
        Fixed::layout(),
        Affine::layout(),
        PlaneLine::layout(),
        View::layout(),
        Dispatch::layout(),
        Scene::layout(),
        RayState::layout(),
        RayErrors::layout(),
        GpuDeviation::layout(),
        RayPart::layout(),
        GpuCounters::layout(),
    ]
}

/// The text of `shaders/shared/layout.wgsl`.
#[must_use]
pub fn wgsl() -> String {
    let mut text = "// Constants and structs shared with Rust. Written by gpu/layout.rs; do not edit.\n\n".to_owned();
    text.push_str(&constants_wgsl());
    text.push_str("// Explained where Rust defines them: crates/format/src/brick.rs, crates/scene/src/scene/mod.rs, and in crates/runtime/src: lod/deviation.rs, engines/rules.rs, engines/blocks.rs, engines/cells/quadrature.rs, engines/packets (blocks.rs, shade.rs, turn.rs, highlight.rs), engines/gpu/limits.rs.\n");
    for (name, ty, value) in borrowed::constants() {
        text.push_str(&format!("const {name}: {ty} = {value};\n"));
    }
    for layout in structs() {
        text.push('\n');
        text.push_str(&layout.wgsl);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engines::gpu::shaders;
    use crate::engines::gpu::shaders::TexelAccess;

    const FILE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../shaders/shared/layout.wgsl");

    #[test]
    fn the_file_is_what_this_module_writes() {
        if std::env::var_os("UPDATE_LAYOUT").is_some() {
            std::fs::write(FILE, wgsl()).unwrap();
        }
        let file = std::fs::read_to_string(FILE).unwrap();
        assert!(file == wgsl(), "shaders/shared/layout.wgsl is out of date: run this test with UPDATE_LAYOUT=1");
    }

    fn parsed(module: &shaders::ShaderModule, texels: TexelAccess) -> naga::Module {
        let source = module.source(texels);
        let parsed = naga::front::wgsl::parse_str(&source)
            .unwrap_or_else(|e| panic!("{}: {}", module.name, e.emit_to_string(&source)));
        let flags = naga::valid::ValidationFlags::all();
        naga::valid::Validator::new(flags, naga::valid::Capabilities::empty())
            .validate(&parsed)
            .unwrap_or_else(|e| panic!("{}: {}", module.name, e.emit_to_string(&source)));
        parsed
    }

    /// Core WebGPU only: no capability is granted.
    #[test]
    fn every_shader_is_valid() {
        for module in shaders::DRAWING.into_iter().chain(shaders::TESTING) {
            for texels in [TexelAccess::Stored, TexelAccess::Sampled] {
                let parsed = parsed(&module, texels);
                assert!(parsed.entry_points.iter().any(|e| e.name == module.name), "no entry point {}", module.name);
            }
        }
    }

    /// Drivers may compile a shader anew for each value of a uniform on which it branches: see decision 010.
    #[test]
    fn no_shader_of_a_picture_reads_a_uniform() {
        for module in shaders::DRAWING {
            let parsed = parsed(&module, TexelAccess::Sampled);
            let uniforms: Vec<_> =
                parsed.global_variables.iter().filter(|(_, v)| v.space == naga::AddressSpace::Uniform).collect();
            assert!(uniforms.is_empty(), "{}: {uniforms:?}", module.name);
        }
    }

    #[test]
    fn fields_sit_where_the_compiled_shader_expects_them() {
        let module = parsed(&shaders::RAYCAST, TexelAccess::Stored);
        for layout in structs() {
            let found = module.types.iter().find_map(|(_, ty)| match &ty.inner {
                naga::TypeInner::Struct { members, span } if ty.name.as_deref() == Some(layout.name) => {
                    Some((members, *span))
                }
                _ => None,
            });
            let Some((members, span)) = found else { panic!("{} is not in the shader", layout.name) };
            let found: Vec<_> =
                members.iter().map(|m| (m.name.clone().unwrap_or_default(), m.offset as usize)).collect();
            let expected: Vec<_> = layout.fields.iter().map(|&(name, offset)| (name.to_owned(), offset)).collect();
            assert_eq!(found, expected, "{}", layout.name);
            assert_eq!(span as usize, layout.size, "size of {}", layout.name);
        }
    }

    /// Style: an entry is read on one screen.
    #[test]
    fn entries_are_short() {
        for module in shaders::DRAWING.into_iter().chain(shaders::TESTING) {
            let (name, text) = module.entry;
            assert!(text.lines().count() <= 80, "{name} has more than 80 lines");
        }
    }
}
