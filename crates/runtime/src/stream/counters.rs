//! What is counted while a picture is made: one struct for what streaming does, one for rays, one for a graphics device.
//!
//! Whoever counts keeps a struct of its own and fills in what it sees; those of threads, passes and parts are added up where they come
//! together. Units stand in the names: without one a field counts things or events, `bytes` are bytes and `ms` are milliseconds.
//! [`crate::render::stats::FrameStats`] is made of these, so that their names are names in `--stats` files, which are a contract.
//!
//! Only what adds up is here. Largest values (peaks, bounds) and what there is now (bytes, slots) stand beside those that know them.

use std::time::Duration;

use serde::Serialize;

/// A time in milliseconds.
#[must_use]
pub fn milliseconds(time: Duration) -> f64 {
    time.as_secs_f64() * 1e3
}

/// Structs of sums: one list of fields serves the struct, the addition and the subtraction.
macro_rules! sums {
    ($($(#[$about:meta])* pub struct $name:ident { $($(#[$field_about:meta])* pub $field:ident: $kind:ty,)* })*) => {$(
        $(#[$about])*
        #[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
        pub struct $name {
            $($(#[$field_about])* pub $field: $kind,)*
        }

        impl $name {
            /// Adds what was counted elsewhere.
            pub fn add(&mut self, other: &Self) {
                $(self.$field += other.$field;)*
            }

            /// What has been counted since the counters stood at `before`.
            #[must_use]
            pub fn since(&self, before: &Self) -> Self {
                Self { $($field: self.$field - before.$field,)* }
            }
        }
    )*};
}

sums! {
    /// What streaming did and cost.
    pub struct StreamCounters {
        /// Bricks that a pass used, summed over passes.
        pub uses: u64,
        /// Bricks that a pass wanted in vain, summed over passes.
        pub misses: u64,
        /// Bricks that came into the host cache.
        pub page_ins: u64,
        /// Of these: bricks that had been there before.
        pub repeated_page_ins: u64,
        /// Bricks that left the host cache.
        pub evictions: u64,
        /// Wanted bricks that no ray wanted any more before they were read.
        pub cancelled: u64,
        /// Bricks whose state was forgotten because the table of states was full.
        pub states_forgotten: u64,
        /// Reads of brick records, failed ones included.
        pub reads: u64,
        /// Of these: reads that fetched several records.
        pub merged_reads: u64,
        /// Of these: reads that failed, those that were tried again included.
        pub failed_reads: u64,
        /// Bytes that these reads fetched, gaps between records included.
        pub bytes_read: u64,
        /// Bytes of voxels decoded, as stored.
        pub bytes_decoded: u64,
        /// Reads that were tried again, because the failure might pass.
        pub retried_reads: u64,
        /// Time in reads, summed over the threads that read.
        pub read_ms: f64,
        /// Wall time of waiting for reads.
        pub wait_ms: f64,
        /// Wall time of decoding.
        pub decode_ms: f64,
        /// Wall time of deciding which bricks to read, and which to drop.
        pub plan_ms: f64,
    }

    /// What rays did.
    pub struct RayCounters {
        /// Rays begun.
        pub rays: u64,
        /// Rays that ended before they left the volume, because nothing behind could be seen.
        pub rays_terminated_early: u64,
        /// Values classified.
        pub samples: u64,
        /// Trilinear cells crossed.
        pub cells: u64,
        /// Cells of packets that one rule did not settle, and that were cut into parts.
        pub cells_refined: u64,
        /// Cells of packets that parts did not settle, and that were integrated by roots in `f64`.
        pub cells_exact: u64,
        /// Macro cells walked cell by cell; rays in packets are not counted.
        pub macro_cells: u64,
        /// Macro cells skipped; leaps of rays in packets.
        pub macro_cells_skipped: u64,
        /// Bricks entered by rays.
        #[serde(skip)]
        pub bricks: u64,
        /// Times a failed brick's parent stood in. A picture's `fallbacks` are those of all of its stages.
        #[serde(skip)]
        pub parent_bricks: u64,
        /// Rays that a pass finished.
        #[serde(skip)]
        pub rays_finished: u64,
        /// Times a ray stopped at a brick that is not resident; in one pass: rays that wait.
        #[serde(skip)]
        pub rays_waiting: u64,
    }

    /// What a graphics device did and cost.
    pub struct DeviceCounters {
        /// Bricks copied to the graphics device.
        #[serde(rename = "gpu_page_ins")]
        pub page_ins: u64,
        /// Times a loop on the graphics device hit its limit: a ray is not exact there.
        #[serde(rename = "gpu_anomalies")]
        pub anomalies: u64,
        /// Wall time of copying bricks to the graphics device.
        pub upload_ms: f64,
        /// Bytes of voxels copied to it, as texels.
        pub upload_bytes: u64,
        /// Bytes written to it in all: voxels, and tables, of which most come with another scene.
        #[serde(rename = "gpu_written_bytes")]
        pub written_bytes: u64,
        /// Bytes read back from it: counters, lists of bricks, pixels.
        #[serde(rename = "gpu_read_bytes")]
        pub read_bytes: u64,
        /// Pieces of work handed to its queue.
        #[serde(rename = "gpu_submits")]
        pub submits: u64,
        /// Of these: runs of rays that were cast.
        #[serde(rename = "gpu_dispatches")]
        pub dispatches: u64,
        /// Bricks that left it to make room.
        #[serde(skip)]
        pub evictions: u64,
        /// Passes cast.
        #[serde(skip)]
        pub passes: u64,
        /// Wall time of passes, read-back included.
        #[serde(skip)]
        pub pass_ms: f64,
        /// Times a ray reached the work limit of a dispatch and went on in the next.
        #[serde(skip)]
        pub interruptions: u64,
        /// Misses that the list had no room for; they come again in the next pass.
        #[serde(skip)]
        pub misses_not_listed: u64,
        /// Bricks left out because they and all their ancestors have failed, counted per ray.
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
