//! Paths of rays through one brick, for tests: the walker of packets alone.

use super::leap::ProximityCloud;
use super::simd::{InstructionSet, LANES_LIMIT, Simd, Task, dispatch};
pub use super::walk::ROUND;
use super::walk::{Packet, WalkedBrick, Walker};
use crate::engines::blocks::BLOCK;

/// Distance from the middle of the outermost voxels of a core beyond which a ray has left it: its faces, and some rounding.
const BORDER: f32 = 0.6;

/// A ray in a brick's own coordinates: voxel (0, 0, 0) is the first of its core.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LocalRay {
    /// Position at entry, in cells.
    pub origin: [f32; 3],
    /// Cells per world length; 0 where parallel.
    pub direction: [f32; 3],
    /// World length in the brick.
    pub length: f32,
}

/// An interval of a ray.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RayInterval {
    /// World length from the entry to its beginning and its end.
    pub t: [f32; 2],
    /// Whether it was leapt over; else its cells were walked.
    pub is_leap: bool,
}

/// The path of each ray through a brick with `core` core voxels along each axis, with this instruction set: its
/// intervals, in order.
///
/// # Panics
/// If the cloud is not that of a brick of this size, or a ray leaves it.
#[must_use]
pub fn intervals(
    set: InstructionSet,
    cloud: &ProximityCloud<BLOCK>,
    core: [usize; 3],
    rays: &[LocalRay],
) -> Vec<Vec<RayInterval>> {
    for ray in rays {
        for a in 0..3 {
            let ends = [ray.origin[a], ray.origin[a] + ray.length * ray.direction[a]];
            let faces = -BORDER..=core[a] as f32 - 1.0 + BORDER;
            assert!(ends.iter().all(|end| faces.contains(end)), "{ray:?} leaves a core of {core:?} voxels");
        }
    }
    let brick = WalkedBrick::new(core).with_cloud(Some(cloud));
    dispatch(set, Trace { brick, rays })
}

struct Trace<'a> {
    brick: WalkedBrick<'a>,
    rays: &'a [LocalRay],
}

impl Task for Trace<'_> {
    type Output = Vec<Vec<RayInterval>>;

    #[inline(always)]
    fn run<S: Simd>(self) -> Vec<Vec<RayInterval>> {
        self.rays.chunks(S::LANES).flat_map(|rays| self.packet::<S>(rays)).collect()
    }
}

impl Trace<'_> {
    /// Walks like [`super::packet`]: leaps until no ray can leap, then a round of cells.
    #[inline(always)]
    fn packet<S: Simd>(&self, rays: &[LocalRay]) -> Vec<Vec<RayInterval>> {
        // SAFETY: `intervals` has looked at the ends of all rays.
        let mut walker = unsafe { Walker::<S>::new(&packet_of(rays), &self.brick) };
        let mut found = vec![Vec::new(); rays.len()];
        let mut note = |lanes: u32, is_leap: bool, [before, after]: [S::F; 2]| {
            let mut t = [[0.0; LANES_LIMIT]; 2];
            S::store(before, &mut t[0]);
            S::store(after, &mut t[1]);
            for lane in (0..rays.len()).filter(|&lane| lanes >> lane & 1 == 1) {
                found[lane].push(RayInterval { t: [t[0][lane], t[1][lane]], is_leap });
            }
        };
        loop {
            loop {
                let before = walker.t;
                let leaping = walker.leap_once();
                if leaping == 0 {
                    break;
                }
                note(leaping, true, [before, walker.t]);
            }
            let (active, before) = (S::bits(walker.active()), walker.t);
            if active == 0 {
                return found;
            }
            let _ = walker.round();
            note(active, false, [before, walker.t]);
        }
    }
}

fn packet_of(rays: &[LocalRay]) -> Packet {
    let mut packet = Packet::default();
    for (lane, ray) in rays.iter().enumerate() {
        for a in 0..3 {
            packet.origin[a][lane] = ray.origin[a];
            packet.direction[a][lane] = ray.direction[a];
        }
        packet.length[lane] = ray.length;
    }
    packet
}
