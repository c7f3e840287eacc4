//! Opens a volume and writes its default picture: `cargo run --release -p supervol --example open_and_draw -- VOLUME PICTURE.png`
//!
//! The volume is a container, or any volume file. Its container is then built first, and kept in the user's cache folder.

use std::error::Error;

use supervol::{Options, Scene, Volume};

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let (input, output) = arguments.next().zip(arguments.next()).ok_or("expected VOLUME PICTURE.png")?;

    let volume = Volume::open(input)?;
    let picture = volume.draw(&Scene::default(), &Options::default())?;
    picture.save(output)?;

    match picture.failures().first() {
        Some(failure) => Err(format!("{} was not read: {}", failure.brick, failure.reason).into()),
        None => Ok(()),
    }
}
