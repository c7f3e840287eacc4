//! Canvas for lines and text on a finished picture, in front of or behind the volume.

use std::convert::Infallible;

use embedded_graphics::Pixel;
use embedded_graphics::draw_target::DrawTarget;
use embedded_graphics::geometry::{Dimensions, OriginDimensions, Point, Size};
use embedded_graphics::mono_font::MonoTextStyle;
use embedded_graphics::mono_font::iso_8859_1::FONT_6X10;
use embedded_graphics::pixelcolor::BinaryColor;
use embedded_graphics::prelude::{Drawable, Primitive};
use embedded_graphics::primitives::{Line, PointsIter, PrimitiveStyle, Rectangle};
use embedded_graphics::text::{Alignment, Baseline, Text, TextStyleBuilder};
use supervol_format::cast::{single, whole};
use supervol_scene::image::Image;

/// Size of a letter in pixels: width, height.
pub const LETTER: [i32; 2] = [6, 10];
/// Least pixels between texts that are written only where there is room.
const APART: i32 = 4;
/// Grey of lines and letters on a dark and on a light background, in [0, 1].
const ON_DARK: f32 = 0.85;
const ON_LIGHT: f32 = 0.10;

/// Share of the background's colour that is mixed into the pixels under a text.
const DIMMING: f32 = 0.7;

/// Depth of a drawing relative to the volume.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Layer {
    /// In front of the volume.
    Before,
    /// Behind the volume, according to its opacity.
    Behind,
}

/// The point of a text that lies at the given position.
#[derive(Debug, Clone, Copy)]
pub enum Anchor {
    /// Its upper left corner.
    TopLeft,
    /// The middle of its upper edge.
    TopMiddle,
    /// The middle of its lower edge.
    BottomMiddle,
    /// Its lower left corner.
    BottomLeft,
    /// Its lower right corner.
    BottomRight,
    /// The middle of its left edge.
    MiddleLeft,
    /// The middle of its right edge.
    MiddleRight,
}

/// A text with its position and style.
type Letters<'t> = Text<'t, MonoTextStyle<'static, BinaryColor>>;

/// A picture with drawing operations.
pub struct Canvas<'a> {
    image: &'a mut Image,
    background: [f32; 3],
    ink: f32,
    layer: Layer,
    /// Areas that texts cover.
    taken: Vec<Rectangle>,
}

impl<'a> Canvas<'a> {
    /// A canvas with a line colour that contrasts with the background.
    pub fn new(image: &'a mut Image, background: [f64; 3]) -> Self {
        let is_dark = background.iter().sum::<f64>() < 1.5;
        let as_stored = background.map(single);
        Self {
            image,
            background: as_stored,
            ink: if is_dark { ON_DARK } else { ON_LIGHT },
            layer: Layer::Before,
            taken: vec![],
        }
    }

    /// Width and height in pixels.
    pub fn size(&self) -> [i32; 2] {
        [self.image.width, self.image.height].map(|n| i32::try_from(n).unwrap_or(i32::MAX))
    }

    /// Draws a line between two points in pixels, clipped to the picture.
    pub fn line(&mut self, from: [f64; 2], to: [f64; 2], layer: Layer) {
        let Some(ends) = clipped(from, to, self.size().map(f64::from)) else { return };
        let [from, to] = ends.map(|p| Point::new(whole::<i32>(p[0].round()), whole::<i32>(p[1].round())));
        self.layer = layer;
        let Ok(()) = Line::new(from, to).into_styled(PrimitiveStyle::with_stroke(BinaryColor::On, 1)).draw(self);
        self.layer = Layer::Before;
    }

    /// Writes a text, shifted into the picture and below existing texts as needed; omitted if there is no room.
    pub fn text(&mut self, text: &str, at: [i32; 2], anchor: Anchor) {
        let mut text = self.placed(text, at, anchor);
        let height = self.size()[1];
        let mut area = text.bounding_box();
        while let Some(other) = self.taken_by(&area) {
            let down = other.top_left.y + i32::try_from(other.size.height).unwrap_or(height) - area.top_left.y;
            area.top_left.y += down;
            text.position.y += down;
            if area.top_left.y + i32::try_from(area.size.height).unwrap_or(height) > height {
                return;
            }
        }
        self.write(&text);
    }

    /// Writes a text, shifted into the picture as needed; omitted if another text overlaps or is closer than about a
    /// letter. Returns whether it was written.
    pub fn text_where_free(&mut self, text: &str, at: [i32; 2], anchor: Anchor) -> bool {
        let text = self.placed(text, at, anchor);
        let Rectangle { mut top_left, mut size } = text.bounding_box();
        top_left.x -= APART;
        size.width += 2 * APART.unsigned_abs();
        let is_free = self.taken_by(&Rectangle { top_left, size }).is_none();
        if is_free {
            self.write(&text);
        }
        is_free
    }

    /// A text shifted into the picture.
    fn placed<'t>(&self, text: &'t str, [x, y]: [i32; 2], anchor: Anchor) -> Letters<'t> {
        let (alignment, baseline) = match anchor {
            Anchor::TopLeft => (Alignment::Left, Baseline::Top),
            Anchor::TopMiddle => (Alignment::Center, Baseline::Top),
            Anchor::BottomMiddle => (Alignment::Center, Baseline::Bottom),
            Anchor::BottomLeft => (Alignment::Left, Baseline::Bottom),
            Anchor::BottomRight => (Alignment::Right, Baseline::Bottom),
            Anchor::MiddleLeft => (Alignment::Left, Baseline::Middle),
            Anchor::MiddleRight => (Alignment::Right, Baseline::Middle),
        };
        let style = TextStyleBuilder::new().alignment(alignment).baseline(baseline).build();
        let mut text =
            Text::with_text_style(text, Point::new(x, y), MonoTextStyle::new(&FONT_6X10, BinaryColor::On), style);
        let bounds = text.bounding_box();
        let [width, height] = self.size();
        let inside = |low: i32, length: u32, room: i32| {
            let most = (room - i32::try_from(length).unwrap_or(room)).max(0);
            low.clamp(0, most) - low
        };
        text.position.x += inside(bounds.top_left.x, bounds.size.width, width);
        text.position.y += inside(bounds.top_left.y, bounds.size.height, height);
        text
    }

    fn taken_by(&self, area: &Rectangle) -> Option<Rectangle> {
        self.taken.iter().find(|other| !other.intersection(area).is_zero_sized()).copied()
    }

    fn write(&mut self, text: &Letters<'_>) {
        let area = text.bounding_box();
        self.taken.push(area);
        self.dim(area);
        let Ok(_) = text.draw(self);
    }

    /// Mixes the background's colour into an area, so that a text on it is readable.
    fn dim(&mut self, area: Rectangle) {
        let background = self.background;
        for point in area.points() {
            if let Some(pixel) = self.pixel(point.x, point.y) {
                let [.., alpha] = *pixel;
                let shown: [f32; 3] = std::array::from_fn(|c| pixel[c] + (1.0 - alpha) * background[c]);
                let mixed: [f32; 3] = std::array::from_fn(|c| shown[c] + DIMMING * (background[c] - shown[c]));
                *pixel = [mixed[0], mixed[1], mixed[2], 1.0];
            }
        }
    }

    /// Number of texts that reach into an area.
    pub fn texts_in(&self, [left, top]: [i32; 2], size: [i32; 2]) -> usize {
        let [width, height] = size.map(|n| u32::try_from(n).unwrap_or(0));
        let area = Rectangle::new(Point::new(left, top), Size::new(width, height));
        self.taken.iter().filter(|text| !text.intersection(&area).is_zero_sized()).count()
    }

    /// Number of pixels of an area that are not empty.
    pub fn covered(&self, [left, top]: [i32; 2], [width, height]: [i32; 2]) -> usize {
        let [columns, rows] = self.size();
        let xs = left.max(0)..(left + width).min(columns);
        let pixels = (top.max(0)..(top + height).min(rows)).flat_map(|y| xs.clone().map(move |x| (x, y)));
        let index = |(x, y): (i32, i32)| {
            whole::<usize>(f64::from(y)) * self.image.width as usize + whole::<usize>(f64::from(x))
        };
        pixels.filter(|at| self.image.pixels[index(*at)][3] > 0.0).count()
    }

    /// Draws a row of pixels with one colour.
    pub fn row(&mut self, [left, y]: [i32; 2], pixels: i32, color: [f64; 3]) {
        for x in left..left + pixels {
            if let Some(pixel) = self.pixel(x, y) {
                *pixel = [single(color[0]), single(color[1]), single(color[2]), 1.0];
            }
        }
    }

    fn pixel(&mut self, x: i32, y: i32) -> Option<&mut [f32; 4]> {
        let (x, y) = (u32::try_from(x).ok()?, u32::try_from(y).ok()?);
        let inside = x < self.image.width && y < self.image.height;
        inside.then(|| &mut self.image.pixels[y as usize * self.image.width as usize + x as usize])
    }
}

impl OriginDimensions for Canvas<'_> {
    fn size(&self) -> Size {
        Size::new(self.image.width, self.image.height)
    }
}

impl DrawTarget for Canvas<'_> {
    type Color = BinaryColor;
    type Error = Infallible;

    fn draw_iter<I: IntoIterator<Item = Pixel<BinaryColor>>>(&mut self, pixels: I) -> Result<(), Infallible> {
        let (ink, layer) = (self.ink, self.layer);
        for Pixel(point, color) in pixels {
            let Some(pixel) = self.pixel(point.x, point.y).filter(|_| color.is_on()) else { continue };
            match layer {
                Layer::Before => *pixel = [ink, ink, ink, 1.0],
                Layer::Behind => {
                    let through = 1.0 - pixel[3];
                    pixel[..3].iter_mut().for_each(|c| *c += through * ink);
                    pixel[3] = 1.0;
                }
            }
        }
        Ok(())
    }
}

/// The part of a line inside the picture (Liang, Barsky 1984); `None` if there is none.
fn clipped(from: [f64; 2], to: [f64; 2], size: [f64; 2]) -> Option<[[f64; 2]; 2]> {
    let (mut start, mut end) = (0.0f64, 1.0f64);
    for axis in 0..2 {
        let step = to[axis] - from[axis];
        if step == 0.0 {
            if !(0.0..=size[axis]).contains(&from[axis]) {
                return None;
            }
            continue;
        }
        let faces = [(0.0 - from[axis]) / step, (size[axis] - from[axis]) / step];
        start = start.max(faces[0].min(faces[1]));
        end = end.min(faces[0].max(faces[1]));
    }
    let at = |share: f64| [0, 1].map(|i| from[i] + share * (to[i] - from[i]));
    (start <= end).then(|| [at(start), at(end)])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image(alpha: f32) -> Image {
        Image { width: 40, height: 20, pixels: vec![[0.0, 0.0, 0.0, alpha]; 800] }
    }

    #[test]
    fn lines_lie_before_or_behind_and_end_at_the_border() {
        let mut picture = image(0.75);
        let mut canvas = Canvas::new(&mut picture, [0.0; 3]);
        canvas.line([-1e9, 5.0], [1e9, 5.0], Layer::Before);
        canvas.line([3.0, -50.0], [3.0, 50.0], Layer::Behind);
        canvas.line([-5.0, -5.0], [-1.0, 30.0], Layer::Before);
        assert_eq!(picture.pixels[5 * 40 + 39], [ON_DARK, ON_DARK, ON_DARK, 1.0]);
        assert!((picture.pixels[12 * 40 + 3][0] - 0.25 * ON_DARK).abs() < 1e-6);
        assert_eq!(picture.pixels[12 * 40 + 20][0], 0.0);
    }

    #[test]
    fn texts_do_not_lie_upon_each_other() {
        let mut picture = image(0.0);
        let mut canvas = Canvas::new(&mut picture, [1.0; 3]);
        for text in ["H", "H", "H"] {
            canvas.text(text, [5, 0], Anchor::TopLeft);
        }
        // Letters have ten rows: two of three texts have room.
        let rows = |from: usize| picture.pixels[from * 40..][..400].iter().filter(|p| p[0] == ON_LIGHT).count();
        assert!(rows(0) > 8 && rows(0) == rows(10), "{} and {}", rows(0), rows(10));
    }

    #[test]
    fn texts_are_left_out_where_others_are() {
        let mut picture = image(0.0);
        let mut canvas = Canvas::new(&mut picture, [1.0; 3]);
        for (text, x) in [("H", 5), ("M", 8), ("H", 20)] {
            canvas.text_where_free(text, [x, 0], Anchor::TopLeft);
        }
        let inked = |picture: &Image| picture.pixels.iter().filter(|p| p[0] == ON_LIGHT).count();
        let mut alone = image(0.0);
        Canvas::new(&mut alone, [1.0; 3]).text_where_free("H", [5, 0], Anchor::TopLeft);
        assert_eq!(inked(&picture), 2 * inked(&alone), "two letters H, and none between them");
    }

    #[test]
    fn texts_are_moved_into_the_picture() {
        let inked = |x: i32, y: i32| {
            let mut picture = image(0.0);
            Canvas::new(&mut picture, [1.0; 3]).text("H", [x, y], Anchor::TopLeft);
            picture.pixels.iter().filter(|p| p[0] == ON_LIGHT).count()
        };
        assert!(inked(5, 5) > 8);
        assert_eq!(inked(500, -90), inked(5, 5));
        assert_eq!(inked(-500, 900), inked(5, 5));
    }
}
