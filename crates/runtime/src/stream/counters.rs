//! Counters of one picture: one struct for streaming, one for rays, one for a graphics device.
//!
//! Each counting part keeps a struct of its own. Threads, passes and parts are added up when they are joined. Units
//! stand in the names: `bytes` and `ms` (milliseconds); a field without a unit counts things or events.
//! [`crate::render::stats::FrameStats`] consists of these structs, so their field names are keys of `--stats` files,
//! which are a contract.
//!
//! Only sums are here. Largest values (peaks, bounds) and current values (bytes, slots) are kept beside the code that
//! knows them.

use std::time::Duration;

use serde::Serialize;

/// A time in milliseconds.
#[must_use]
pub fn milliseconds(time: Duration) -> f64 {
    time.as_secs_f64() * 1e3
}

/// Defines structs of sums: one list of fields gives the struct, the addition and the subtraction.
macro_rules! sums {
    ($($(#[$about:meta])* pub struct $name:ident { $($(#[$field_about:meta])* pub $field:ident: $kind:ty,)* })*) => {$(
        $(#[$about])*
        #[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
        pub struct $name {
            $($(#[$field_about])* pub $field: $kind,)*
        }

        impl $name {
            /// Adds other counters to these.
            pub fn add(&mut self, other: &Self) {
                $(self.$field += other.$field;)*
            }

            /// Counts since the counters stood at `before`.
            #[must_use]
            pub fn since(&self, before: &Self) -> Self {
                Self { $($field: self.$field - before.$field,)* }
            }
        }
    )*};
}

sums! {
    /// Counters of streaming.
    pub struct StreamCounters {
        /// Bricks used by a pass, summed over passes.
        pub uses: u64,
        /// Missing bricks of a pass, summed over passes.
        pub misses: u64,
        /// Bricks that came into the host cache.
        pub page_ins: u64,
        /// Page-ins of bricks that had been in the cache before.
        pub repeated_page_ins: u64,
        /// Bricks that left the host cache.
        pub evictions: u64,
        /// Wanted bricks that were cancelled before they were read, because no ray wanted them any more.
        pub cancelled: u64,
        /// Bricks whose state was forgotten because the table of states was full.
        pub states_forgotten: u64,
        /// Reads of brick records, failed ones included.
        pub reads: u64,
        /// Reads that fetched several records.
        pub merged_reads: u64,
        /// Reads that failed, including those that were retried.
        pub failed_reads: u64,
        /// Bytes that these reads fetched, gaps between records included.
        pub bytes_read: u64,
        /// Bytes of voxels decoded, as stored.
        pub bytes_decoded: u64,
        /// Bricks packed when they came, because the bricks of a frame do not fit into the host cache otherwise.
        pub bricks_packed: u64,
        /// Packed bricks unpacked for rays.
        pub bricks_unpacked: u64,
        /// Reads repeated because the failure might be temporary.
        pub retried_reads: u64,
        /// Time in reads, summed over the reading threads.
        pub read_ms: f64,
        /// Wall time of waiting for reads.
        pub wait_ms: f64,
        /// Wall time of decoding.
        pub decode_ms: f64,
        /// Wall time of deciding which bricks to read and which to evict.
        pub plan_ms: f64,
    }

    /// Counters of rays.
    pub struct RayCounters {
        /// Rays begun.
        pub rays: u64,
        /// Rays that ended inside the volume, because nothing behind that point could be seen.
        pub rays_terminated_early: u64,
        /// Values classified.
        pub samples: u64,
        /// Trilinear cells crossed.
        pub cells: u64,
        /// Cells of packets that were cut into parts, because a single rule was not accurate enough.
        pub cells_refined: u64,
        /// Cells of packets that were integrated by roots in `f64`, because parts were not accurate enough.
        pub cells_exact: u64,
        /// Macro cells walked cell by cell; rays in packets are not counted.
        pub macro_cells: u64,
        /// Macro cells skipped; for rays in packets: leaps.
        pub macro_cells_skipped: u64,
        /// Bricks entered by rays.
        #[serde(skip)]
        pub bricks: u64,
        /// Times the parent of a failed brick stood in. A picture's `fallbacks` are the sum over all its stages.
        #[serde(skip)]
        pub parent_bricks: u64,
        /// Rays that a pass finished.
        #[serde(skip)]
        pub rays_finished: u64,
        /// Times a ray stopped at a brick that is not resident. In one pass: rays that wait.
        #[serde(skip)]
        pub rays_waiting: u64,
    }

    /// Counters of a graphics device.
    pub struct DeviceCounters {
        /// Bricks copied to the graphics device.
        #[serde(rename = "gpu_page_ins")]
        pub page_ins: u64,
        /// Times a loop on the graphics device hit its limit. Such a ray is not exact.
        #[serde(rename = "gpu_anomalies")]
        pub anomalies: u64,
        /// Wall time of copying bricks to the graphics device.
        pub upload_ms: f64,
        /// Bytes of voxels copied to the device, as texels.
        pub upload_bytes: u64,
        /// All bytes written to the device: voxels and tables. Most tables change only with the scene.
        #[serde(rename = "gpu_written_bytes")]
        pub written_bytes: u64,
        /// Bytes read back from the device: counters, lists of bricks, pixels.
        #[serde(rename = "gpu_read_bytes")]
        pub read_bytes: u64,
        /// Command buffers submitted to the device's queue.
        #[serde(rename = "gpu_submits")]
        pub submits: u64,
        /// Dispatches of ray casting among them.
        #[serde(rename = "gpu_dispatches")]
        pub dispatches: u64,
        /// Bricks evicted from the device to make room.
        #[serde(skip)]
        pub evictions: u64,
        /// Passes cast.
        #[serde(skip)]
        pub passes: u64,
        /// Wall time of passes, read-back included.
        #[serde(skip)]
        pub pass_ms: f64,
        /// Times a ray reached the work limit of a dispatch and continued in the next.
        #[serde(skip)]
        pub interruptions: u64,
        /// Misses that did not fit into the list; they come again in the next pass.
        #[serde(skip)]
        pub misses_not_listed: u64,
        /// Bricks left out because they and all their ancestors failed, counted per ray.
        #[serde(skip)]
        pub bricks_lost: u64,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_added_is_what_has_been_counted_since() {
        let before = StreamCounters { reads: 3, read_ms: 1.5, ..StreamCounters::default() };
        let more = StreamCounters { reads: 4, bytes_read: 100, read_ms: 0.25, ..StreamCounters::default() };
        let mut all = before;
        all.add(&more);
        assert_eq!((all.reads, all.bytes_read, all.read_ms), (7, 100, 1.75));
        assert_eq!(all.since(&before), more);
        assert_eq!(milliseconds(Duration::from_micros(1_500)), 1.5);
    }
}
