//! Errors of large pictures at some of their pixels: the reference integrator is too slow for all pixels.
//!
//! The pixels are drawn at random, without repetition, among those with a ray through the drawn domain. The seed is
//! fixed, so every program and run uses the same pixels. Rare errors may be missed.

use supervol_format::cast::index;
use supervol_format::random::Random;
use supervol_format::{Dims, Geometry};
use supervol_runtime::engines::reference::ReferenceCaster;
use supervol_scene::clip::{IndexRay, clip_ray};
use supervol_scene::image::Image;
use supervol_scene::scene::ResolvedScene;

use super::cases::Case;
use super::results::Levels;
use crate::context::{ChartError, Pace};
use crate::measure::{GREY_LEVELS, distance_of};

/// Seed for drawing the pixels.
pub const SEED: u64 = 12_345;
/// Reference pixels between two checks of the clock.
const CHUNK: usize = 32;

/// Exact values of some pixels of a picture.
#[derive(Debug)]
pub struct ExactPixels {
    pixels: Vec<[u32; 2]>,
    exact: Vec<[f32; 4]>,
    /// Intervals at which the reference did not converge. If there are any, errors may be the reference's own.
    pub capped_pieces: u64,
}

impl ExactPixels {
    /// Draws `count` pixels of a case, or all pixels that meet the volume if there are fewer. `None` if the volume is
    /// too large for the reference or not in the picture.
    ///
    /// # Errors
    /// If the volume cannot be read.
    pub fn new(
        case: &Case<'_>,
        scene: &ResolvedScene,
        count: usize,
        say: &(dyn Fn(&str) + Sync),
    ) -> Result<Option<Self>, ChartError> {
        let pixels = chosen(scene, case, count);
        let Some(volume) = case.built.exact(scene)?.filter(|_| !pixels.is_empty()) else { return Ok(None) };
        let caster = ReferenceCaster::new(volume, scene);
        let mut exact = Vec::with_capacity(pixels.len());
        let pace = Pace::new(say);
        for chunk in pixels.chunks(CHUNK) {
            exact.extend(caster.pixels(chunk, &|| ()));
            pace.tell(|| format!("  reference: {} of {} pixels", exact.len(), pixels.len()));
        }
        let capped_pieces = caster.capped_pieces();
        Ok(Some(Self { pixels, exact, capped_pieces }))
    }

    /// Number of pixels.
    #[must_use]
    pub fn count(&self) -> usize {
        self.pixels.len()
    }

    /// Distance of a picture from the exact values at these pixels.
    #[must_use]
    pub fn distance(&self, picture: &Image) -> Levels {
        let at = |&[x, y]: &[u32; 2]| picture.pixels[y as usize * picture.width as usize + x as usize];
        let found: Vec<[f32; 4]> = self.pixels.iter().map(at).collect();
        levels(found.as_flattened(), self.exact.as_flattened())
    }
}

/// Distance in grey levels of 255.
pub fn levels(channels: &[f32], exact: &[f32]) -> Levels {
    let d = distance_of(channels, exact);
    Levels {
        linf: GREY_LEVELS * d.linf,
        p999: GREY_LEVELS * d.p999,
        rmse: GREY_LEVELS * d.rmse,
        bias: GREY_LEVELS * d.bias,
    }
}

/// The chosen pixels, in order of choice (partial shuffle of Fisher and Yates 1938).
fn chosen(scene: &ResolvedScene, case: &Case<'_>, count: usize) -> Vec<[u32; 2]> {
    let facts = &case.built.volume.facts;
    let mut candidates = pixels_that_meet(scene, facts.dims, &facts.geometry);
    let mut random = Random::new(SEED);
    let wanted = count.min(candidates.len());
    for i in 0..wanted {
        let j = i + index(random.below((candidates.len() - i) as u64));
        candidates.swap(i, j);
    }
    candidates.truncate(wanted);
    candidates
}

/// Pixels with a ray through the drawn domain, row by row. With several rays per pixel, the first one counts.
fn pixels_that_meet(scene: &ResolvedScene, dims: Dims, geometry: &Geometry) -> Vec<[u32; 2]> {
    let [width, height] = scene.image_size;
    let meets = |&[x, y]: &[u32; 2]| {
        let ray = scene.camera.ray(x * scene.subgrid, y * scene.subgrid);
        clip_ray(&ray, &IndexRay::new(&ray, geometry), dims, &scene.clip).is_some()
    };
    (0..height).flat_map(|y| (0..width).map(move |x| [x, y])).filter(meets).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::peers::cases::{Looks, Subject, planned};
    use crate::{Context, Scale};

    #[test]
    fn the_same_pixels_are_chosen_each_time_and_show_the_volume() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let context = Context { scale: Scale::Small, folder: folder.path(), say: &|_| () };
        let only = Subject::Scenes(vec!["marschner-lobb".into()]);
        let plan = planned(&context, &only, Some(16)).expect("a scene");
        let built = plan[0].build(&context, Looks::Unshaded, &[]).expect("a small volume");
        let case = built.cases()[0];
        let scene = case.scene([64, 48]).expect("a scene");
        let few = chosen(&scene, &case, 100);
        assert_eq!(few, chosen(&scene, &case, 100));
        let mut distinct = few.clone();
        distinct.sort_unstable();
        distinct.dedup();
        assert_eq!(distinct.len(), 100);
        let all = chosen(&scene, &case, usize::MAX);
        // From 2.6 edges away, 16 voxels fill 20 to 67 % of the picture.
        assert!((600..2000).contains(&all.len()), "{}", all.len());

        // Scenes are in index space, for any spacing of the synthetic volume.
        let survey = &planned(&context, &Subject::Scenes(vec!["seismic".into()]), Some(16)).expect("a scene")[0];
        let survey = survey.build(&context, Looks::Unshaded, &[]).expect("a small volume");
        assert_eq!(survey.volume.facts.geometry, Geometry::IDENTITY);
        assert_eq!(chosen(&survey.cases()[0].scene([64, 48]).expect("a scene"), &survey.cases()[0], 100), few);

        let exact = ExactPixels::new(&case, &scene, 100, &|_| ()).expect("it is read").expect("it is small");
        let mut picture = Image { width: 64, height: 48, pixels: vec![[0.0; 4]; 64 * 48] };
        for ([x, y], pixel) in exact.pixels.iter().zip(&exact.exact) {
            picture.pixels[(y * 64 + x) as usize] = *pixel;
        }
        assert_eq!(exact.distance(&picture).linf, 0.0);
        let [x, y] = exact.pixels[7];
        picture.pixels[(y * 64 + x) as usize][3] += 10.0 / 255.0;
        let off = exact.distance(&picture);
        assert!((off.linf - 10.0).abs() < 1e-4 && (off.bias - 10.0 / 400.0).abs() < 1e-5, "{off:?}");
    }
}
