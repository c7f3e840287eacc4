//! Threads that read while others cast, and do nothing else: decoding is left to the threads that compute.
//!
//! Reads wait in one queue, in the order in which they were asked for; those that no thread has begun can be taken back.

use std::sync::Arc;
use std::time::Instant;

use crossbeam_channel::{Receiver, RecvTimeoutError, Sender, bounded};
use supervol_format::Container;

use super::io::{Answer, MergedRead, read_merged};
use crate::stream::counters::StreamCounters;

/// Threads that read: enough to keep a disk or a network busy while one of them waits.
pub const READERS: usize = 4;
/// What the names of these threads begin with.
pub const READER: &str = "reader";
/// Most reads that wait for a thread, or are under way.
pub const QUEUE_LIMIT: usize = 64;

/// A read that has come back.
#[derive(Debug)]
pub struct Finished {
    /// What was read at once.
    pub read: MergedRead,
    /// Its records.
    pub answers: Vec<Answer>,
    /// What that cost.
    pub counters: StreamCounters,
}

/// Reads in the background.
#[derive(Debug)]
pub struct Loader {
    queue: Sender<MergedRead>,
    waiting: Receiver<MergedRead>,
    finished: Receiver<Finished>,
    /// Reads that were asked for and have not come back.
    pending: usize,
}

impl Loader {
    /// Starts the threads.
    ///
    /// # Errors
    /// If the system has none left.
    pub fn new(container: &Arc<Container>) -> std::io::Result<Self> {
        let (queue, waiting) = bounded::<MergedRead>(QUEUE_LIMIT);
        // Nobody waits to hand a read over: no more are under way than may be asked for.
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

    /// Reads that were asked for and have not come back.
    #[must_use]
    pub fn pending(&self) -> usize {
        self.pending
    }

    /// Asks for a read.
    ///
    /// # Panics
    /// If there is no room for it.
    pub fn ask(&mut self, read: MergedRead) {
        assert!(self.pending < QUEUE_LIMIT, "more than {QUEUE_LIMIT} reads");
        self.pending += 1;
        self.queue.send(read).expect("the loader itself holds a receiver");
    }

    /// Takes back all reads that no thread has begun.
    pub fn take_back(&mut self) -> Vec<MergedRead> {
        let taken: Vec<MergedRead> = self.waiting.try_iter().collect();
        self.pending -= taken.len();
        taken
    }

    /// The reads that have come back.
    pub fn take_finished(&mut self) -> Vec<Finished> {
        let taken: Vec<Finished> = self.finished.try_iter().collect();
        self.pending -= taken.len();
        taken
    }

    /// The next read that comes back until then.
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
    /// Reads under way are not waited for, or a picture by a deadline would be late: their threads end with them.
    fn drop(&mut self) {
        self.take_back();
    }
}
