//! A frame knows engines, not rays. An engine that visits the volume slab by slab, in an order of its own, uses the
//! same passes as a ray caster, with a cache of any size.

#![allow(clippy::unwrap_used, reason = "helpers of tests are tests")]

use std::ops::Range;
use std::sync::Arc;
use std::time::Instant;

use supervol_format::{BrickKey, Container, Lod, VoxelType};
use supervol_runtime::engines::engine::{Advance, Engine};
use supervol_runtime::engines::error::EngineError;
use supervol_runtime::engines::totals::EngineTotals;
use supervol_runtime::render::frame::{FrameWalk, streamer_for};
use supervol_runtime::render::options::{Backend, LevelChoice, RenderOptions};
use supervol_runtime::render::renderer::Renderer;
use supervol_runtime::render::volume::PlacedVolume;
use supervol_runtime::stream::classify::Skipping;
use supervol_runtime::stream::priority::BrickOrder;
use supervol_runtime::stream::residency::{BrickView, DecodedBrick, Resident, Voxels};
use supervol_runtime::stream::streamer::HostView;
use supervol_scene::image::Image;
use supervol_scene::scene::ResolvedScene;
use supervol_scene::value_map::ValueMap;
use supervol_scene::value_map::value_map;

use crate::{containers, support};
use containers::{container_bytes, open, plan};
use support::{Volume, noise, scene};

const DIMS: [usize; 3] = [40, 36, 52];
const APRON: usize = 2;

/// Engine that draws the greatest value along z, a pixel for each line of voxels, from the last slab to the first. Its
/// working set is known: all bricks of level 0.
struct Slabs {
    container: Arc<Container>,
    map: ValueMap,
    left: Vec<BrickKey>,
    taken: Vec<BrickKey>,
    image: Image,
}

impl Slabs {
    fn new(container: &Arc<Container>) -> Self {
        let [width, height] = [DIMS[0] as u32, DIMS[1] as u32];
        let pixels = vec![[f32::NEG_INFINITY; 4]; DIMS[0] * DIMS[1]];
        let image = Image { width, height, pixels };
        Self { container: container.clone(), map: value_map(container), left: Vec::new(), taken: Vec::new(), image }
    }

    fn take(&mut self, brick: &DecodedBrick) {
        let Voxels::U8(voxels) = &brick.voxels else { panic!("the volume is of bytes") };
        let core = self.container.pyramid().core_box(brick.key);
        let [nx, ny, _] = brick.extent.map(|n| n as usize);
        let [x0, y0, _] = core.start.map(|n| n as usize);
        let [cx, cy, cz] = core.extent();
        for (z, y, x) in (0..cz).flat_map(|z| (0..cy).flat_map(move |y| (0..cx).map(move |x| (z, y, x)))) {
            let stored = voxels[x + APRON + nx * (y + APRON + ny * (z + APRON))];
            let value = self.map.to_data(self.map.from_stored_number(f32::from(stored))) as f32;
            let pixel = &mut self.image.pixels[x0 + x + DIMS[0] * (y0 + y)];
            *pixel = pixel.map(|greatest| greatest.max(value));
        }
        self.taken.push(brick.key);
    }
}

impl Engine for Slabs {
    fn order(&self) -> Option<BrickOrder> {
        Some(BrickOrder::along([0, 0, -1]))
    }

    fn begin(&mut self, pixel_rows: Range<u32>) -> Result<(), EngineError> {
        assert_eq!(pixel_rows, 0..DIMS[1] as u32, "it makes the picture as a whole");
        self.left = self.container.pyramid().keys_of(Lod(0)).collect();
        Ok(())
    }

    fn advance(&mut self, view: &HostView<'_>) -> Result<Advance, EngineError> {
        let mut used = Vec::new();
        for key in std::mem::take(&mut self.left) {
            match view.lookup(key) {
                Resident::Brick(brick) => {
                    self.take(&brick.read());
                    used.push(key);
                }
                Resident::Missing => self.left.push(key),
                other => panic!("{key} is {other:?}"),
            }
        }
        let [wanted, used] = [self.left.clone(), used].map(|keys| view.field().bricks(keys));
        Ok(Advance { remaining: wanted.len() as u64, wanted, used, ..Advance::default() })
    }

    fn write_image(&mut self, to: &mut [[f32; 4]]) -> Result<(), EngineError> {
        to.copy_from_slice(&self.image.pixels);
        Ok(())
    }

    fn totals(&self) -> EngineTotals {
        EngineTotals::default()
    }
}

/// The volume, its container, a scene, options, and the greatest value of each line of voxels.
fn setting() -> (Arc<Container>, ResolvedScene, RenderOptions, Vec<f32>) {
    let volume = Volume::new(DIMS, VoxelType::U8, |p| 1.0 + 250.0 * noise(p));
    let container = open(&container_bytes(&volume, 16));
    // A camera that looks along x: its order differs.
    let camera = r#""eye": [-90, 18, 26], "target": [20, 18, 26], "up": [0, 0, 1], "fov_y": 30"#;
    let image = format!(r#""image": {{"width": {}, "height": {}}}"#, DIMS[0], DIMS[1]);
    let scene = scene(&volume, &format!(r#"{{"camera": {{{camera}}}, {image}, "transfer_function": "grey"}}"#));
    let level = LevelChoice::Fixed(Lod(0));
    let options = RenderOptions { level, skipping: Skipping::Off, ..RenderOptions::default() };
    let greatest = (0..DIMS[0] * DIMS[1])
        .map(|line| (0..DIMS[2]).map(|z| volume.values[line + DIMS[0] * DIMS[1] * z]).fold(0.0, f64::max) as f32)
        .collect();
    (container, scene, options, greatest)
}

#[test]
fn an_engine_without_rays_gets_its_bricks_in_its_own_order_each_once() {
    let (container, scene, options, expected) = setting();
    let bricks = container.pyramid().level_at(Lod(0)).brick_count();
    for cache_bricks in [1, 5, 1000] {
        let plan = plan(&container, &scene, cache_bricks);
        let mut streamer = streamer_for(&container, &scene, &options, plan);
        let mut engine = Slabs::new(&container);
        let mut walk = FrameWalk::new(&mut streamer, plan, &options, Instant::now());
        let found = walk.run(&mut engine, scene.image_size).expect("a picture");
        let stats = walk.into_stats();
        assert!(found.pixels.iter().zip(&expected).all(|(pixel, value)| pixel[0] == *value), "{cache_bricks} bricks");
        assert_eq!((stats.streaming.page_ins, stats.streaming.repeated_page_ins), (bricks, 0), "{cache_bricks} bricks");
        assert!(
            stats.converged && stats.casting.rays == 0 && stats.passes > u64::from(cache_bricks < bricks),
            "{stats:#?}"
        );
        // With room for one brick they come one by one.
        if cache_bricks == 1 {
            assert!(engine.taken.is_sorted_by_key(|key| u32::MAX - key.brick().0[2]), "{:?}", engine.taken);
        }
    }
}

#[test]
fn a_renderer_keeps_bricks_from_picture_to_picture_of_engines_from_outside() {
    let (container, scene, options, expected) = setting();
    let engines = |container: &Arc<Container>, _: &ResolvedScene, _: &RenderOptions| {
        Ok(Box::new(Slabs::new(container)) as Box<dyn Engine + Send>)
    };
    let mut renderer = Renderer::by_engines(PlacedVolume::of(container.clone()), options.clone(), engines).unwrap();
    let moved = ResolvedScene { background: [0.5; 3], ..scene.clone() };
    assert_ne!(moved, scene);
    for (number, scene) in [scene, moved].into_iter().enumerate() {
        renderer.set_scene(scene);
        let step = renderer.advance(None).unwrap();
        assert!(step.is_finished && step.bricks_failed == 0, "{step:?}");
        let picture = renderer.picture().expect("a finished picture");
        assert!(picture.pixels.iter().zip(&expected).all(|(pixel, value)| pixel[0] == *value), "picture {number}");
        let bricks = if number == 0 { container.pyramid().level_at(Lod(0)).brick_count() } else { 0 };
        assert_eq!(renderer.stats().streaming.page_ins, bricks, "picture {number}");
        assert_eq!(renderer.stats().backend, "engine");
        // Another backend in the options does not replace the engines.
        renderer.set_options(RenderOptions { backend: Backend::Reference, ..options.clone() }).unwrap();
    }
}
