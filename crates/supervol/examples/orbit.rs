//! Turns the camera once around a volume, with a deadline for each frame:
//! `cargo run --release -p supervol --example orbit -- VOLUME FOLDER`
//!
//! Each frame is the best picture that 33 ms allow. Bricks stay in memory from frame to frame, and the last frame is drawn on
//! until it has converged.

#![allow(clippy::print_stdout, reason = "an example shows what it finds")]

use std::error::Error;
use std::path::PathBuf;
use std::time::Duration;

use supervol::scene::camera_path::turntable;
use supervol::scene::preset::view::upright;
use supervol::{Options, Scene, Volume};

const FRAMES: u32 = 24;
const FRAME_TIME: Duration = Duration::from_millis(33);

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let (input, folder) = arguments.next().zip(arguments.next()).ok_or("expected VOLUME FOLDER")?;
    let folder = PathBuf::from(folder);
    std::fs::create_dir_all(&folder)?;

    let volume = Volume::open(input)?;
    let mut scene = volume.complete(&Scene::from_json(r#"{"image": {"width": 320, "height": 240}}"#)?)?;
    let first = scene.camera.clone().ok_or("this volume is too far from the origin for a camera in world units")?;
    let mut renderer = volume.renderer(Options::default())?;

    for (number, camera) in turntable(&first, upright(volume.facts()), FRAMES).into_iter().enumerate() {
        scene.camera = Some(camera);
        renderer.set_scene(&scene)?;
        let step = renderer.advance_for(FRAME_TIME)?;
        let picture = renderer.picture().ok_or("a deadline leaves a whole picture")?;
        picture.save(folder.join(format!("frame-{number:02}.png")))?;
        println!("frame {number}: {} pixels unfinished", step.pixels_unfinished);
    }

    renderer.advance(None)?;
    let last = renderer.picture().ok_or("there is a picture")?;
    last.save(folder.join("converged.png"))?;
    assert!(last.is_converged(), "without a deadline a picture converges");
    Ok(())
}
