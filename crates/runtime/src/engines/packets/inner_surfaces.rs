//! Surfaces inside the semi-transparent volume: mode `dvr` with iso values (docs/decisions/025-surfaces-in-volumes.md).
//!
//! In each brick, the rays of a tile first look for surfaces. They use the packets, cells and sides of mode `iso`, but
//! list all crossings in order. Then they gather light up to the first crossing, are dimmed by the surface, gather
//! light up to the next one, and so on. The two kernels are independent. Rays without a crossing in the brick gather in
//! one go. A surface costs the search, and one more walk for the rays that meet it.

use supervol_format::BrickKey;

use super::frame::PacketFrame;
use super::visit::CastTile;
use crate::engines::feedback::BlockFeedback;
use crate::stream::residency::Resident;

/// State of a ray in a brick, from crossing to crossing.
struct Way {
    ray: u16,
    /// World lengths at which it continues, and at which it leaves the brick.
    from: f64,
    exit: f64,
    /// Number of the next crossing, and of the first crossing of another ray.
    next: usize,
    end: usize,
}

impl CastTile<'_> {
    /// Casts the rays that meet a brick through its volume and through the surfaces of a frame.
    pub(super) fn cast_around_surfaces(&mut self, key: BrickKey, resident: Resident<'_>, surfaces: &PacketFrame) {
        let hits = self.rays.hits().to_vec();
        self.find_crossings(key, resident, surfaces);
        self.rays.set_hits(&hits);
        let mut crossings = std::mem::take(&mut self.rays.crossings);
        if crossings.is_empty() {
            return self.cast_resident(key, resident);
        }
        // Stable: the crossings of a ray stay in order.
        crossings.sort_by_key(|(ray, _)| *ray);
        let way = |&ray: &u16| {
            let [from, exit] = self.rays.interval(ray);
            let [next, end] = [ray, ray + 1].map(|ray| crossings.partition_point(|(other, _)| *other < ray));
            Way { ray, from, exit, next, end }
        };
        let mut ways: Vec<Way> = hits.iter().map(way).collect();
        let last = self.tables.end_error();
        while !ways.is_empty() {
            let mut parts = Vec::with_capacity(ways.len());
            for way in &mut ways {
                let to = if way.next < way.end { crossings[way.next].1.t.clamp(way.from, way.exit) } else { way.exit };
                if way.from < to {
                    self.rays.set_interval(way.ray, [way.from, to]);
                    parts.push(way.ray);
                }
                way.from = to;
            }
            self.rays.set_hits(&parts);
            if !parts.is_empty() {
                self.cast_resident(key, resident);
            }
            ways.retain_mut(|way| {
                let is_met = way.next < way.end && self.rays.is_going(usize::from(way.ray));
                if is_met {
                    let surface = &crossings[way.next].1;
                    self.rays.add(way.ray, surface.color, 1.0 - surface.alpha, last);
                    way.next += 1;
                }
                is_met && self.rays.is_going(usize::from(way.ray))
            });
        }
        // The memory is reused.
        crossings.clear();
        self.rays.crossings = crossings;
    }

    /// Lists the surfaces that the rays meet in a brick, and keeps the sides on which they come out.
    fn find_crossings(&mut self, key: BrickKey, resident: Resident<'_>, surfaces: &PacketFrame) {
        let tables = &*surfaces.tables;
        // The search has its own counters: it is not part of the work of a ray.
        let mut feedback = BlockFeedback::default();
        let Self { view, corner, ref mut rays, ref mut queues, .. } = *self;
        CastTile { view, frame: surfaces, tables, corner, rays, queues, feedback: &mut feedback }
            .gather_resident(key, resident);
    }
}
