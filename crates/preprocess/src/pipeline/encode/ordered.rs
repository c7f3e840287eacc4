//! Work of many threads, handed over in order on the calling thread.

use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};

use crate::pipeline::plan::memory::AHEAD_PER_THREAD;

/// Makes pieces 0 to `count` on the pool's threads. The calling thread meanwhile hands them to `take` in order. At most
/// [`AHEAD_PER_THREAD`] pieces per thread exist at once.
///
/// # Errors
/// The first error of `make` or `take`. No piece is begun after it.
///
/// # Panics
/// If `make` panics.
pub(crate) fn in_order<T: Send, E: Send>(
    pool: &rayon::ThreadPool,
    count: usize,
    make: &(dyn Fn(usize) -> Result<T, E> + Sync),
    take: &mut dyn FnMut(T) -> Result<(), E>,
) -> Result<(), E> {
    let ahead = AHEAD_PER_THREAD * pool.current_num_threads();
    pool.in_place_scope(|scope| {
        let (send, made) = crossbeam_channel::bounded(ahead);
        let begin = |number: usize| {
            let send = send.clone();
            // One task per piece, so that threads can run other tasks of the pool in between.
            scope.spawn(move |_| {
                // The panic is passed on. Otherwise the caller would wait for this piece for ever.
                let piece = catch_unwind(AssertUnwindSafe(|| make(number)));
                // After an error the receiver is gone.
                let _ = send.send((number, piece));
            });
        };
        let mut to_begin = 0..count;
        to_begin.by_ref().take(ahead).for_each(&begin);
        let mut waiting = BTreeMap::new();
        for due in 0..count {
            while !waiting.contains_key(&due) {
                let (number, piece) = made.recv().expect("this thread could send, too");
                waiting.insert(number, piece.unwrap_or_else(|panic| resume_unwind(panic))?);
            }
            take(waiting.remove(&due).expect("it has just been there"))?;
            to_begin.by_ref().take(1).for_each(&begin);
        }
        Ok(())
    })
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering};

    use super::*;

    fn pool() -> rayon::ThreadPool {
        rayon::ThreadPoolBuilder::new().num_threads(3).build().expect("three threads can be had")
    }

    #[test]
    fn pieces_come_in_their_order_however_long_each_takes_and_few_are_there_at_once() {
        let (pool, begun) = (pool(), AtomicUsize::new(0));
        let ahead = AHEAD_PER_THREAD * pool.current_num_threads();
        for count in [0, 1, ahead, 5 * ahead + 1] {
            begun.store(0, Ordering::Relaxed);
            let make = |number: usize| {
                begun.fetch_add(1, Ordering::Relaxed);
                std::thread::sleep(std::time::Duration::from_micros(number as u64 * 7919 % 500));
                Ok::<_, ()>(number)
            };
            let mut taken = Vec::new();
            let done = in_order(&pool, count, &make, &mut |number| {
                taken.push(number);
                assert!(begun.load(Ordering::Relaxed) < taken.len() + ahead);
                Ok(())
            });
            assert_eq!((done, taken), (Ok(()), (0..count).collect()));
        }
    }

    #[test]
    #[should_panic(expected = "piece 7")]
    fn a_piece_that_panics_is_not_waited_for() {
        let make = |number: usize| if number == 7 { panic!("piece {number}") } else { Ok::<_, ()>(number) };
        let _ = in_order(&pool(), 20, &make, &mut |_| Ok(()));
    }

    #[test]
    fn the_first_error_ends_it() {
        let (pool, begun) = (pool(), AtomicUsize::new(0));
        let make = |number: usize| {
            begun.fetch_add(1, Ordering::Relaxed);
            if number == 20 { Err("made") } else { Ok(number) }
        };
        assert_eq!(in_order(&pool, 1000, &make, &mut |_| Ok(())), Err("made"));
        assert!(begun.load(Ordering::Relaxed) < 100);
        let mut taken = 0;
        let refused = in_order(&pool, 1000, &|number| Ok(number), &mut |_| {
            taken += 1;
            if taken == 20 { Err("taken") } else { Ok(()) }
        });
        assert_eq!((refused, taken), (Err("taken"), 20));
    }
}
