//! Rays of a picture with slices, composited part by part, front to back.
//!
//! A region's picture is kept only until its parts are composited. Regions are drawn front to back, so each of them is
//! composited as soon as it is finished. Memory is thus that of one region and of the sums, however many regions there
//! are. A picture for every region would take eight times as much for three slices.

use std::collections::{BTreeMap, BTreeSet};

use glam::Vec3;
use rayon::prelude::*;
use supervol_scene::image::Image;

use super::cut::{Cut, RayPart, Sides};
use crate::engines::maps::Maps;

/// The parts of one ray that are composited.
#[derive(Debug, Clone, Copy)]
pub(super) struct RaySum {
    color: Vec3,
    transmittance: f32,
    /// Sum of the errors of the parts; 1 is white.
    error: f32,
    /// Number of parts, front to back, that are composited.
    parts: u8,
}

/// Colour (premultiplied), opacity and error of one part of a ray.
#[derive(Debug, Clone, Copy)]
pub(super) struct Shown {
    pub(super) color: Vec3,
    pub(super) alpha: f32,
    pub(super) error: f32,
}

impl Shown {
    /// A part that shows nothing.
    pub(super) const NOTHING: Self = Self { color: Vec3::ZERO, alpha: 0.0, error: 0.0 };

    /// A part inside the volume: a pixel of its region's picture, and this pixel's error.
    ///
    /// An error in a part's opacity changes everything behind it by as much again.
    pub(super) fn of_region([r, g, b, alpha]: [f32; 4], error: f32) -> Self {
        Self { color: Vec3::new(r, g, b), alpha, error: 2.0 * error }
    }
}

impl RaySum {
    const NOTHING: Self = Self { color: Vec3::ZERO, transmittance: 1.0, error: 0.0, parts: 0 };

    /// Composites further parts until `shown` does not know one.
    pub(super) fn add(&mut self, parts: &[RayPart], shown: impl Fn(RayPart) -> Option<Shown>) {
        for part in &parts[usize::from(self.parts)..] {
            let Some(Shown { color, alpha, error }) = shown(*part) else { return };
            self.color += self.transmittance * color;
            self.transmittance *= 1.0 - alpha;
            self.error += error;
            self.parts += 1;
        }
    }

    /// Colour and opacity.
    pub(super) fn pixel(&self) -> [f32; 4] {
        [self.color.x, self.color.y, self.color.z, 1.0 - self.transmittance]
    }

    /// Sum of the errors, grey, at most 1.
    pub(super) fn error(&self) -> [f32; 4] {
        let error = self.error.min(1.0);
        [error, error, error, 1.0]
    }
}

/// All rays of a picture with slices.
#[derive(Debug, Default)]
pub(super) struct Composite {
    /// Sum of each ray; empty before the first region is composited.
    rays: Vec<RaySum>,
    /// Pictures and errors of finished regions with parts that wait for a part in front of them. Rounding may cause this
    /// for rays along a slice.
    held: BTreeMap<Sides, (Image, Option<Image>)>,
    /// Sum of the works of each ray.
    work: Option<Image>,
    /// Whether a region stated no error.
    pub(super) lacks_errors: bool,
}

impl Composite {
    /// Bytes of a ray's sum.
    pub(super) const RAY_BYTES: u64 = size_of::<RaySum>() as u64;

    /// The sum of a ray.
    pub(super) fn ray(&self, ray: usize) -> RaySum {
        self.rays.get(ray).copied().unwrap_or(RaySum::NOTHING)
    }

    /// Part of a ray in a composited region, if other parts of the region still wait.
    pub(super) fn held(&self, sides: Sides, ray: usize) -> Option<Shown> {
        let (picture, errors) = self.held.get(&sides)?;
        Some(Shown::of_region(picture.pixels[ray], errors.as_ref().map_or(0.0, |errors| errors.pixels[ray][0])))
    }

    /// Composites a finished region, and all slices that its parts were in front of.
    pub(super) fn add_region(
        &mut self,
        cut: &Cut,
        (sides, picture, maps): (Sides, Image, Maps),
        slice: impl Fn(usize, [u32; 2]) -> Shown + Sync,
    ) {
        let [width, height] = cut.rays_size();
        self.lacks_errors |= maps.errors.is_none();
        self.add_work(maps.work);
        self.held.insert(sides, (picture, maps.errors));
        let mut rays = std::mem::take(&mut self.rays);
        if rays.is_empty() {
            rays = vec![RaySum::NOTHING; width as usize * height as usize];
        }
        let rows = rays.par_chunks_mut(width as usize).zip(0..height);
        let waiting = rows.map(|(row, y)| {
            let mut waiting = BTreeSet::new();
            for (x, sum) in (0..width).zip(row) {
                let parts = cut.parts(x, y);
                let ray = y as usize * width as usize + x as usize;
                sum.add(&parts, |part| match part {
                    RayPart::Volume(sides) => self.held(sides, ray),
                    RayPart::Slice(number, _) => Some(slice(number, [x, y])),
                });
                let left = parts[usize::from(sum.parts)..].iter();
                waiting.extend(left.filter_map(|part| match part {
                    RayPart::Volume(sides) => Some(*sides),
                    RayPart::Slice(..) => None,
                }));
            }
            waiting
        });
        let waiting: BTreeSet<Sides> = waiting.reduce(BTreeSet::new, |mut all, more| {
            all.extend(more);
            all
        });
        self.held.retain(|sides, _| waiting.contains(sides));
        self.rays = rays;
    }

    fn add_work(&mut self, work: Option<Image>) {
        match (&mut self.work, work) {
            (Some(sum), Some(work)) => add_work_to(sum, &work),
            (sum, work) => *sum = work,
        }
    }

    /// The work of the composited regions, with that of others.
    pub(super) fn work_with(&self, others: impl IntoIterator<Item = Image>) -> Option<Image> {
        let mut sum = self.work.clone();
        for other in others {
            match &mut sum {
                Some(sum) => add_work_to(sum, &other),
                None => sum = Some(other),
            }
        }
        sum
    }
}

fn add_work_to(sum: &mut Image, work: &Image) {
    for (sum, work) in sum.pixels.iter_mut().zip(&work.pixels) {
        *sum = [sum[0] + work[0], sum[1] + work[1], 0.0, sum[3].max(work[3])];
    }
}
