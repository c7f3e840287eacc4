//! Pictures in a page: PNG as data URIs, and difference pictures.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use supervol_format::cast::single;
use supervol_scene::image::Image;

use super::html::escape;
use super::{figure, html};
use crate::chart::PictureRow;
use crate::measure::distance;

/// Amplification of shown differences: white is 1/32 of full scale or more; one grey level of 256 is one eighth.
const AMPLIFICATION: f64 = 32.0;

/// The picture over black as a data URI.
fn data_uri(image: &Image) -> Result<String, png::EncodingError> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, image.width, image.height);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    let mut writer = encoder.write_header()?;
    writer.write_image_data(&image.to_rgb8([0.0; 3]))?;
    writer.finish()?;
    Ok(format!("data:image/png;base64,{}", STANDARD.encode(bytes)))
}

/// Grey picture of the amplified differences: the greatest channel difference of each pixel.
///
/// # Panics
/// If the pictures differ in size.
#[must_use]
pub fn difference(picture: &Image, exact: &Image) -> Image {
    assert_eq!((picture.width, picture.height), (exact.width, exact.height), "sizes of two pictures to compare");
    let grey = |(a, b): (&[f32; 4], &[f32; 4])| {
        let most = (0..4).map(|c| f64::from((a[c] - b[c]).abs())).fold(0.0, f64::max);
        let grey = single((AMPLIFICATION * most).min(1.0));
        [grey, grey, grey, 1.0]
    };
    Image { pixels: picture.pixels.iter().zip(&exact.pixels).map(grey).collect(), ..*picture }
}

fn tile(image: &Image, caption: &str) -> String {
    let caption = escape(caption);
    match data_uri(image) {
        Ok(uri) => format!("<div><img src=\"{uri}\" alt=\"{caption}\">{caption}</div>"),
        Err(error) => format!("<div>{caption}: {}</div>", escape(&error.to_string())),
    }
}

/// The exact picture, then the pictures of the first methods and their differences.
#[must_use]
pub fn row(row: &PictureRow, methods: usize) -> String {
    let mut tiles = vec![tile(&row.exact, "exact")];
    for (method, parameters, picture) in row.pictures.iter().take(methods) {
        let error = html::number(distance(picture, &row.exact).linf * 255.0);
        tiles.push(tile(picture, &format!("{method}, {parameters}")));
        let caption = format!("its difference × {AMPLIFICATION}; at most {error} grey levels");
        tiles.push(tile(&difference(picture, &row.exact), &caption));
    }
    figure(
        &format!("{}, {}: pictures and where they are wrong", row.scene, row.transfer_function),
        &format!("<div class=\"pictures\">{}</div>", tiles.concat()),
        "Each picture is followed by its difference from the exact one, amplified: black is exact, white is off by 8 of 255 \
         grey levels or more.",
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn differences_are_amplified_and_stop_at_white() {
        let exact = Image { width: 3, height: 1, pixels: vec![[0.5, 0.5, 0.5, 1.0]; 3] };
        let mut picture = exact.clone();
        picture.pixels[1][2] += 1.0 / 255.0;
        picture.pixels[2][0] -= 0.4;
        let grey: Vec<f32> = difference(&picture, &exact).pixels.iter().map(|p| p[0]).collect();
        assert_eq!((grey[0], grey[2]), (0.0, 1.0));
        assert!((f64::from(grey[1]) - AMPLIFICATION / 255.0).abs() < 1e-4);
        assert!(data_uri(&picture).unwrap().starts_with("data:image/png;base64,iVBOR"));
    }
}
