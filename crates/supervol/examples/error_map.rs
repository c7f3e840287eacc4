//! Draws a picture with the stated error of each pixel, and checks it against the reference integrator:
//! `cargo run --release -p supervol --example error_map -- VOLUME FOLDER`

#![allow(clippy::print_stdout, reason = "an example shows what it finds")]

use std::error::Error;
use std::path::PathBuf;

use supervol::{Options, Scene, Volume};

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let (input, folder) = arguments.next().zip(arguments.next()).ok_or("expected VOLUME FOLDER")?;
    let folder = PathBuf::from(folder);
    std::fs::create_dir_all(&folder)?;

    // Two grey levels of 255 are asked for, and the picture is to state its error.
    let options = Options { max_error: 2.0 / 255.0, predict_error: true, ..Options::default() };
    let scene = Scene::from_json(r#"{"image": {"width": 320, "height": 240}}"#)?;
    let picture = Volume::open(input)?.draw(&scene, &options)?;
    picture.save(folder.join("picture.png"))?;

    let stated = picture.error_stated().ok_or("this backend states no error")?;
    let measured = picture.check(2000)?;
    println!(
        "asked for 2 grey levels; stated at most {:.3}; measured at most {:.3} on {} rays",
        stated.largest_grey_levels, measured.largest_grey_levels, measured.rays
    );

    // A map of floats: 1 is full scale.
    let map = picture.error_map().ok_or("this backend has no map of errors")?;
    map.write(&folder.join("errors.npy"), [0.0; 3])?;
    Ok(())
}
