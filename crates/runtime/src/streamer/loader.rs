//! Threads that read while others cast, and do nothing else: decoding is left to the threads that compute.
//!
//! Reads wait in one queue, in the order in which they were asked for; those that no thread has begun can be taken back.

use std::sync::Arc;
use std::time::Instant;

use crossbeam_channel::{Receiver, RecvTimeoutError, Sender, TryRecvError, bounded};
use supervol_format::Container;

use super::io::{Answer, IoCounters, MergedRead, read_merged};

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
    pub counters: IoCounters,
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
                    let mut counters = IoCounters::default();
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

    /// Whether one more read can be asked for.
    #[must_use]
    pub fn has_room(&self) -> bool {
        self.pending < QUEUE_LIMIT
    }

    /// Asks for a read.
    ///
    /// # Panics
    /// If there is no room for it.
    pub fn ask(&mut self, read: MergedRead) {
        assert!(self.has_room(), "more than {QUEUE_LIMIT} reads");
        self.pending += 1;
        self.queue.send(read).expect("the loader itself holds a receiver");
    }

    /// Takes back all reads that no thread has begun.
    pub fn take_back(&mut self) -> Vec<MergedRead> {
        let taken: Vec<MergedRead> = self.waiting.try_iter().collect();
        self.pending -= taken.len();
        taken
    }

    /// A read that has come back, if there is one.
    pub fn next_finished(&mut self) -> Option<Finished> {
        match self.finished.try_recv() {
            Ok(finished) => {
                self.pending -= 1;
                Some(finished)
            }
            Err(TryRecvError::Empty) => None,
            Err(TryRecvError::Disconnected) => panic!("the threads that read live as long as the loader"),
        }
    }

    /// Waits until a read comes back, or for so long; nothing where nothing is pending.
    pub fn wait(&mut self, until: Option<Instant>) -> Option<Finished> {
        if self.pending == 0 {
            return None;
        }
        let received = match until {
            Some(until) => self.finished.recv_deadline(until),
            None => self.finished.recv().map_err(|_| RecvTimeoutError::Disconnected),
        };
        match received {
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
