//! Reader threads: they only read, while other threads cast. Decoding runs on the computing threads.
//!
//! Reads wait in one queue, first come, first served. Reads that no thread has begun can be cancelled.

use std::sync::Arc;
use std::time::Instant;

use crossbeam_channel::{Receiver, RecvTimeoutError, Sender, bounded};
use supervol_format::Container;

use super::io::{Answer, MergedRead, read_merged};
use crate::stream::counters::StreamCounters;

/// Number of reader threads: enough to keep a disk or a network busy while one of them waits.
pub const READERS: usize = 4;
/// Prefix of the names of these threads.
pub const READER: &str = "reader";
/// Most reads that wait for a thread or are in progress.
pub const QUEUE_LIMIT: usize = 64;

/// A finished read.
#[derive(Debug)]
pub struct Finished {
    /// The merged read.
    pub read: MergedRead,
    /// Its records, or their errors.
    pub answers: Vec<Answer>,
    /// Counters of this read.
    pub counters: StreamCounters,
}

/// Loader: reads in the background.
#[derive(Debug)]
pub struct Loader {
    queue: Sender<MergedRead>,
    waiting: Receiver<MergedRead>,
    finished: Receiver<Finished>,
    /// Reads requested and not yet returned.
    pending: usize,
}

impl Loader {
    /// Starts the threads.
    ///
    /// # Errors
    /// If the system cannot start a thread.
    pub fn new(container: &Arc<Container>) -> std::io::Result<Self> {
        let (queue, waiting) = bounded::<MergedRead>(QUEUE_LIMIT);
        // Sending a finished read never blocks: the channel has room for all reads in progress.
        let (done, finished) = bounded(QUEUE_LIMIT);
        for number in 0..READERS {
            let (container, waiting, done) = (container.clone(), waiting.clone(), done.clone());
            let read_all = move || {
                for read in waiting {
                    let mut counters = StreamCounters::default();
                    let read_at = |offset, buffer: &mut [u8]| container.read_at(offset, buffer);
                    let answers = read_merged(&read_at, &read, &mut counters);
                    if done.send(Finished { read, answers, counters }).is_err() {
                        return;
                    }
                }
            };
            std::thread::Builder::new().name(format!("{READER} {number}")).spawn(read_all)?;
        }
        Ok(Self { queue, waiting, finished, pending: 0 })
    }

    /// Reads requested and not yet returned.
    #[must_use]
    pub fn pending(&self) -> usize {
        self.pending
    }

    /// Requests a read.
    ///
    /// # Panics
    /// If the queue is full.
    pub fn ask(&mut self, read: MergedRead) {
        assert!(self.pending < QUEUE_LIMIT, "more than {QUEUE_LIMIT} reads");
        self.pending += 1;
        self.queue.send(read).expect("the loader itself holds a receiver");
    }

    /// Cancels and returns all reads that no thread has begun.
    pub fn take_back(&mut self) -> Vec<MergedRead> {
        let taken: Vec<MergedRead> = self.waiting.try_iter().collect();
        self.pending -= taken.len();
        taken
    }

    /// The finished reads, without waiting.
    pub fn take_finished(&mut self) -> Vec<Finished> {
        let taken: Vec<Finished> = self.finished.try_iter().collect();
        self.pending -= taken.len();
        taken
    }

    /// Waits for the next finished read, at most until `until`.
    pub fn wait(&mut self, until: Instant) -> Option<Finished> {
        match self.finished.recv_deadline(until) {
            Ok(finished) => {
                self.pending -= 1;
                Some(finished)
            }
            Err(RecvTimeoutError::Timeout) => None,
            Err(RecvTimeoutError::Disconnected) => panic!("the threads that read live as long as the loader"),
        }
    }
}

impl Drop for Loader {
    /// Does not wait for reads in progress, which would delay a picture with a deadline: their threads end with them.
    fn drop(&mut self) {
        self.take_back();
    }
}
