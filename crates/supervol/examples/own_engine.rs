//! An engine of one's own: the greatest value along z, slab by slab, without a ray.
//! `cargo run --release -p supervol --example own_engine -- VOLUME PICTURE.png`
//!
//! An engine names the bricks that it wants, in an order of its own. The streamer reads as many as the host budget has room
//! for, and the engine goes on with these. It knows neither files nor threads.

#![allow(clippy::cast_possible_truncation, reason = "an example of a small volume")]
#![allow(clippy::print_stdout, reason = "an example shows what it finds")]

use std::error::Error;
use std::ops::Range;
use std::sync::Arc;

use supervol::runtime::engines::engine::{Advance, Engine};
use supervol::runtime::engines::error::EngineError;
use supervol::runtime::engines::totals::EngineTotals;
use supervol::runtime::stream::priority::BrickOrder;
use supervol::runtime::stream::residency::{BrickView, DecodedBrick, Resident, Voxels};
use supervol::runtime::stream::streamer::HostView;
use supervol::scene::value_map::ValueMap;
use supervol::scene::value_map::value_map;
use supervol::{BrickKey, Container, LevelChoice, Lod, Options, Scene, Volume};

/// Voxels that a brick holds beside its core, on each side.
const APRON: usize = 2;

/// A pixel for each line of voxels along z.
struct Slabs {
    container: Arc<Container>,
    map: ValueMap,
    left: Vec<BrickKey>,
    /// Greatest data value of each pixel, row by row.
    greatest: Vec<f64>,
}

impl Slabs {
    fn new(container: &Arc<Container>) -> Self {
        Self { container: container.clone(), map: value_map(container), left: Vec::new(), greatest: Vec::new() }
    }

    fn size(&self) -> [usize; 2] {
        let [nx, ny, _] = self.container.descriptor().dims().0;
        [nx as usize, ny as usize]
    }

    /// Takes the greatest value of each line of a brick's core.
    fn take(&mut self, brick: &DecodedBrick) {
        let core = self.container.pyramid().core_box(brick.key);
        let [sx, sy, _] = brick.extent.map(|n| n as usize);
        let [x0, y0, _] = core.start.map(|n| n as usize);
        let [cx, cy, cz] = core.extent();
        let width = self.size()[0];
        for (z, y, x) in (0..cz).flat_map(|z| (0..cy).flat_map(move |y| (0..cx).map(move |x| (z, y, x)))) {
            let place = x + APRON + sx * (y + APRON + sy * (z + APRON));
            let render_value = match &brick.voxels {
                Voxels::U8(voxels) => self.map.from_stored_number(f32::from(voxels[place])),
                Voxels::U16(voxels) => self.map.from_stored_number(f32::from(voxels[place])),
                Voxels::F32(voxels) => voxels[place],
            };
            let pixel = &mut self.greatest[x0 + x + width * (y0 + y)];
            *pixel = pixel.max(self.map.to_data(render_value));
        }
    }
}

impl Engine for Slabs {
    fn order(&self) -> Option<BrickOrder> {
        Some(BrickOrder::along([0, 0, 1]))
    }

    fn begin(&mut self, _pixel_rows: Range<u32>) -> Result<(), EngineError> {
        self.left = self.container.pyramid().keys_of(Lod::FINEST).collect();
        self.greatest = vec![f64::NEG_INFINITY; self.size().iter().product()];
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
                // Absent, invisible, uniform or failed bricks add nothing to this picture.
                _ => {}
            }
        }
        let [wanted, used] = [self.left.clone(), used].map(|keys| view.field().bricks(keys));
        Ok(Advance { remaining: wanted.len() as u64, wanted, used, ..Advance::default() })
    }

    fn write_image(&mut self, to: &mut [[f32; 4]]) -> Result<(), EngineError> {
        let present = self.greatest.iter().copied().filter(|value| value.is_finite());
        let (low, high) = present.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)));
        for (pixel, value) in to.iter_mut().zip(&self.greatest) {
            let grey =
                if value.is_finite() { ((value - low) / (high - low).max(f64::MIN_POSITIVE)) as f32 } else { 0.0 };
            *pixel = [grey, grey, grey, 1.0];
        }
        Ok(())
    }

    fn totals(&self) -> EngineTotals {
        EngineTotals::default()
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let (input, output) = arguments.next().zip(arguments.next()).ok_or("expected VOLUME PICTURE.png")?;

    let volume = Volume::open(input)?;
    let [width, height, _] = volume.dims().0;
    let scene = Scene::from_json(&format!(
        r#"{{"image": {{"width": {width}, "height": {height}}}, "mode": "mip", "transfer_function": "grey"}}"#
    ))?;
    let mut engine = Slabs::new(volume.placed_for(&scene)?.container());
    let options = Options { level: LevelChoice::Fixed(Lod::FINEST), ..Options::default() };
    let picture = volume.draw_by(&mut engine, &scene, &options)?;
    picture.save(output)?;
    println!("{} bricks read, each once", picture.stats().streaming.page_ins);
    Ok(())
}
