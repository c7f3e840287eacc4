//! The WGSL files, in the order in which they are joined into modules.
//!
//! Modules are whole files, joined end to end. WGSL lets a function use one that is declared further down, so the order
//! only matters to readers: layout, bindings, then the data path.

use super::layout::{FLAG_LIGHT, FLAG_SHADED, FLAG_SURFACES};

/// Name below `shaders/`, and text.
type ShaderFile = (&'static str, &'static str);

/// One module: the files it shares with others, in order, then its own.
#[derive(Debug, Clone, Copy)]
pub struct ShaderModule {
    /// Name in messages.
    pub name: &'static str,
    /// Files that hold functions only.
    pub shared: &'static [ShaderFile],
    /// The file with the entry point.
    pub entry: ShaderFile,
}

macro_rules! file {
    ($path:literal) => {
        ($path, include_str!(concat!("../../../../../shaders/", $path)))
    };
}

/// All files of a ray, without an entry point. The parameters are the files with alternatives: the walk through a
/// brick, and the effect of light and of surfaces on a part.
macro_rules! ray {
    ($resident:literal, $light:literal, $surfaces:literal) => {
        &[
            file!("shared/layout.wgsl"),
            file!("shared/config.wgsl"),
            file!("shared/camera.wgsl"),
            file!("shared/segment.wgsl"),
            file!("shared/page_table.wgsl"),
            file!("shared/brick.wgsl"),
            file!("shared/leap.wgsl"),
            file!("shared/cubic.wgsl"),
            file!("shared/sample.wgsl"),
            file!("shared/transfer_function.wgsl"),
            file!("shared/shading.wgsl"),
            file!("shared/quadrature.wgsl"),
            file!("shared/compositing.wgsl"),
            file!("shared/pieces.wgsl"),
            file!("shared/integrate.wgsl"),
            file!("shared/light_shading.wgsl"),
            file!("shared/inner_surfaces.wgsl"),
            file!("shared/cell.wgsl"),
            file!("shared/light_walk.wgsl"),
            file!($light),
            file!($surfaces),
            file!("shared/feedback.wgsl"),
            file!("shared/errors.wgsl"),
            file!($resident),
            file!("shared/walk.wgsl"),
        ]
    };
}

/// By cells and roots: all modes.
const RAY: &[ShaderFile] = ray!("shared/resident_cells.wgsl", "shared/light_lit.wgsl", "shared/light_surfaces.wgsl");

/// Casts rays until they finish, lack a brick, or reach the dispatch's limit.
pub const RAYCAST: ShaderModule = ShaderModule { name: "raycast", shared: RAY, entry: file!("raycast.wgsl") };

macro_rules! raycast_light {
    ($light:literal, $surfaces:literal) => {
        ShaderModule { shared: ray!("shared/resident_light.wgsl", $light, $surfaces), ..RAYCAST }
    };
}

/// The same by parts of cells, if `FLAG_LIGHT` is set.
pub const RAYCAST_LIGHT: ShaderModule = raycast_light!("shared/light_unlit.wgsl", "shared/light_no_surfaces.wgsl");

/// The same with light.
pub const RAYCAST_LIGHT_SHADED: ShaderModule = raycast_light!("shared/light_lit.wgsl", "shared/light_no_surfaces.wgsl");

/// The same with surfaces.
pub const RAYCAST_LIGHT_SURFACES: ShaderModule =
    raycast_light!("shared/light_unlit.wgsl", "shared/light_surfaces.wgsl");

/// The same with light and surfaces.
pub const RAYCAST_LIGHT_SHADED_SURFACES: ShaderModule =
    raycast_light!("shared/light_lit.wgsl", "shared/light_surfaces.wgsl");

/// The module that casts rays with these flags.
#[must_use]
pub fn raycast_for(flags: u32) -> ShaderModule {
    let has = |flag: u32| flags & flag != 0;
    match (has(FLAG_LIGHT), has(FLAG_SHADED), has(FLAG_SURFACES)) {
        (false, ..) => RAYCAST,
        (true, false, false) => RAYCAST_LIGHT,
        (true, true, false) => RAYCAST_LIGHT_SHADED,
        (true, false, true) => RAYCAST_LIGHT_SURFACES,
        (true, true, true) => RAYCAST_LIGHT_SHADED_SURFACES,
    }
}

/// Clips the rays of a band.
pub const BEGIN_RAYS: ShaderModule = ShaderModule { name: "begin_rays", shared: RAY, entry: file!("begin_rays.wgsl") };

/// Starts rays on their next part.
pub const BEGIN_PARTS: ShaderModule =
    ShaderModule { name: "begin_parts", shared: RAY, entry: file!("begin_parts.wgsl") };

/// Decides which macro cells are visible.
pub const CLASSIFY_CELLS: ShaderModule =
    ShaderModule { name: "classify_cells", shared: RAY, entry: file!("classify_cells.wgsl") };

/// Puts the values gathered by rays into the order of pixels.
pub const GATHER_PIXELS: ShaderModule =
    ShaderModule { name: "gather_pixels", shared: RAY, entry: file!("gather_pixels.wgsl") };

/// Completes the miss list with its counts.
pub const GATHER_MISSES: ShaderModule = ShaderModule {
    name: "gather_misses",
    shared: &[file!("shared/layout.wgsl"), file!("shared/config.wgsl")],
    entry: file!("gather_misses.wgsl"),
};

/// For the tests: single functions on given numbers.
pub const TEST_TWINS: ShaderModule = ShaderModule { name: "test_twins", shared: RAY, entry: file!("test_twins.wgsl") };

/// For the tests: parts of rays and their light.
pub const TEST_LIGHT: ShaderModule = ShaderModule { name: "test_light", shared: RAY, entry: file!("test_light.wgsl") };

/// For the tests: positions on rays, bricks, pages and gradients.
pub const TEST_PLACES: ShaderModule =
    ShaderModule { name: "test_places", shared: RAY, entry: file!("test_places.wgsl") };

/// For the tests: arithmetic of walking rays.
pub const TEST_WALK: ShaderModule = ShaderModule { name: "test_walk", shared: RAY, entry: file!("test_walk.wgsl") };

/// For the tests: positions in textures, marks of surfaces.
pub const TEST_SLOTS: ShaderModule = ShaderModule { name: "test_slots", shared: RAY, entry: file!("test_slots.wgsl") };

/// For the tests: effect of coarser bricks on rays.
pub const TEST_ERRORS: ShaderModule =
    ShaderModule { name: "test_errors", shared: RAY, entry: file!("test_errors.wgsl") };

/// Modules of the tests, beside [`DRAWING`].
pub const TESTING: [ShaderModule; 6] = [TEST_TWINS, TEST_LIGHT, TEST_PLACES, TEST_WALK, TEST_SLOTS, TEST_ERRORS];

/// Modules of pictures.
pub const DRAWING: [ShaderModule; 10] = [
    RAYCAST,
    RAYCAST_LIGHT,
    RAYCAST_LIGHT_SHADED,
    RAYCAST_LIGHT_SURFACES,
    RAYCAST_LIGHT_SHADED_SURFACES,
    BEGIN_RAYS,
    BEGIN_PARTS,
    CLASSIFY_CELLS,
    GATHER_MISSES,
    GATHER_PIXELS,
];

/// The way shaders read the textures that they read most: as storage textures, or as sampled ones. The pictures are the
/// same.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TexelAccess {
    /// For software adapters: fewer instructions for an address.
    Stored,
    /// For graphics hardware: larger caches.
    Sampled,
}

impl TexelAccess {
    /// The file that declares them.
    fn file(self) -> ShaderFile {
        match self {
            Self::Stored => file!("shared/texels_stored.wgsl"),
            Self::Sampled => file!("shared/texels_sampled.wgsl"),
        }
    }

    /// The usage flags of such textures.
    #[must_use]
    pub fn usage(self) -> wgpu::TextureUsages {
        match self {
            Self::Stored => wgpu::TextureUsages::STORAGE_BINDING,
            Self::Sampled => wgpu::TextureUsages::TEXTURE_BINDING,
        }
    }
}

impl ShaderModule {
    /// The files joined.
    #[must_use]
    pub fn source(&self, texels: TexelAccess) -> String {
        let files = self.shared.iter().copied().chain([texels.file(), self.entry]);
        files.map(|(_, text)| text).collect::<Vec<_>>().join("\n")
    }
}
