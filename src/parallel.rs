//! Loops over columns, serial when they are short or when there is one thread.
//!
//! Each call of the closure writes only its own row, so the result does not depend on the number
//! of threads. A loop is split only if every thread gets at least one chunk: a parallel region pays from
//! about 30 us of work, if its threads are asleep, and from a few when they are kept [`awake`].
use rayon::prelude::*;
use std::ops::Range;
use std::sync::atomic::{AtomicBool, Ordering};

/// Runs `work` with the other threads of the pool watching for jobs all the time instead of falling asleep between
/// two parallel regions: to wake a thread takes longer than most loops of a step.
///
/// Does nothing for models with fewer than `WORTH` rows, in which no loop is split, and outside of a pool. For programs that run
/// one model at a time in a pool: two that keep each other's threads awake would wait for each other.
pub fn awake<R>(rows: usize, work: impl FnOnce() -> R) -> R {
    let Some(here) = rayon::current_thread_index().filter(|_| rows >= WORTH && rayon::current_num_threads() > 1) else { return work() };
    /// Lets the others go, also when `work` panics.
    struct Over<'a>(&'a AtomicBool);
    impl Drop for Over<'_> {
        fn drop(&mut self) {
            self.0.store(true, Ordering::Release);
        }
    }
    let over = AtomicBool::new(false);
    rayon::in_place_scope(|scope| {
        scope.spawn_broadcast(|_, context| {
            while context.index() != here && !over.load(Ordering::Acquire) {
                if rayon::yield_now() != Some(rayon::Yield::Executed) {
                    std::thread::yield_now();
                }
            }
        });
        let _over = Over(&over);
        work()
    })
}

/// Rows from which loops are split.
const WORTH: usize = 1000;

fn serial(rows: usize, chunk: usize) -> bool {
    rows < 2 * chunk || rayon::current_num_threads() == 1
}

/// Runs `a` and `b`, beside each other if the rows that they go through are worth it.
pub fn both(rows: usize, a: impl FnOnce() + Send, b: impl FnOnce() + Send) {
    if serial(rows, PAIR) {
        a();
        b();
    } else {
        rayon::join(a, b);
    }
}

/// Half of the rows from which two pieces of work run beside each other.
const PAIR: usize = 128;

/// Sets every row of a column.
pub fn fill<A: Copy + Send + Sync>(a: &mut [A], value: A, chunk: usize) {
    if serial(a.len(), chunk) {
        a.fill(value);
    } else {
        a.par_chunks_mut(chunk).for_each(|a| a.fill(value));
    }
}

/// Runs `f` on every pair of rows.
pub fn zip2<A: Send, B: Sync>(a: &mut [A], b: &[B], chunk: usize, f: impl Fn(&mut A, &B) + Sync) {
    chunks2_mut(a, b, chunk, |a, b| a.iter_mut().zip(b).for_each(|(a, b)| f(a, b)));
}

/// Runs `f` on every chunk of two columns of which the first is written.
pub fn chunks2_mut<A: Send, B: Sync>(a: &mut [A], b: &[B], chunk: usize, f: impl Fn(&mut [A], &[B]) + Sync) {
    assert_eq!(a.len(), b.len(), "columns of one table have one length");
    if serial(a.len(), chunk) {
        f(a, b);
    } else {
        a.par_chunks_mut(chunk).zip(b.par_chunks(chunk)).for_each(|(a, b)| f(a, b));
    }
}

/// Runs `f` on every triple of rows of which the first is written.
pub fn zip3<A: Send, B: Sync, C: Sync>(a: &mut [A], b: &[B], c: &[C], chunk: usize, f: impl Fn(&mut A, &B, &C) + Sync) {
    assert!(a.len() == b.len() && b.len() == c.len(), "columns of one table have one length");
    if serial(a.len(), chunk) {
        a.iter_mut().zip(b).zip(c).for_each(|((a, b), c)| f(a, b, c));
    } else {
        a.par_chunks_mut(chunk)
            .zip(b.par_chunks(chunk))
            .zip(c.par_chunks(chunk))
            .for_each(|((a, b), c)| a.iter_mut().zip(b).zip(c).for_each(|((a, b), c)| f(a, b, c)));
    }
}

/// Runs `f` on every chunk of three columns of which the first and the last are written.
pub fn chunks3_mut<A: Send, B: Sync, C: Send>(
    a: &mut [A],
    b: &[B],
    c: &mut [C],
    chunk: usize,
    f: impl Fn(&mut [A], &[B], &mut [C]) + Sync,
) {
    assert!(a.len() == b.len() && b.len() == c.len(), "columns of one table have one length");
    if serial(a.len(), chunk) {
        f(a, b, c);
    } else {
        a.par_chunks_mut(chunk).zip(b.par_chunks(chunk)).zip(c.par_chunks_mut(chunk)).for_each(|((a, b), c)| f(a, b, c));
    }
}

/// Places in the list of those picked rows (in order) that lie in a range.
fn picked_in(picked: &[u32], rows: Range<usize>) -> Range<usize> {
    picked.partition_point(|i| (*i as usize) < rows.start)..picked.partition_point(|i| (*i as usize) < rows.end)
}

/// Runs `f` on the place and the number of every picked row (in order) and the row of a column that is written.
pub fn picked1<A: Send>(a: &mut [A], picked: &[u32], chunk: usize, f: impl Fn(usize, usize, &mut A) + Sync) {
    let run = |first: usize, a: &mut [A]| {
        for place in picked_in(picked, first..first + a.len()) {
            let i = picked[place] as usize;
            f(place, i, &mut a[i - first]);
        }
    };
    if serial(picked.len(), chunk) {
        run(0, a);
    } else {
        a.par_chunks_mut(chunk).enumerate().for_each(|(k, a)| run(k * chunk, a));
    }
}

/// As [`picked1`], with two columns that are written.
pub fn picked2<A: Send, B: Send>(a: &mut [A], b: &mut [B], picked: &[u32], chunk: usize, f: impl Fn(usize, usize, &mut A, &mut B) + Sync) {
    assert_eq!(a.len(), b.len(), "columns of one table have one length");
    let run = |first: usize, a: &mut [A], b: &mut [B]| {
        for place in picked_in(picked, first..first + a.len()) {
            let i = picked[place] as usize;
            f(place, i, &mut a[i - first], &mut b[i - first]);
        }
    };
    if serial(picked.len(), chunk) {
        run(0, a, b);
    } else {
        a.par_chunks_mut(chunk).zip(b.par_chunks_mut(chunk)).enumerate().for_each(|(k, (a, b))| run(k * chunk, a, b));
    }
}

/// As [`picked1`], with three columns that are written.
pub fn picked3<A: Send, B: Send, C: Send>(
    a: &mut [A],
    b: &mut [B],
    c: &mut [C],
    picked: &[u32],
    chunk: usize,
    f: impl Fn(usize, usize, &mut A, &mut B, &mut C) + Sync,
) {
    assert!(a.len() == b.len() && b.len() == c.len(), "columns of one table have one length");
    let run = |first: usize, a: &mut [A], b: &mut [B], c: &mut [C]| {
        for place in picked_in(picked, first..first + a.len()) {
            let i = picked[place] as usize;
            f(place, i, &mut a[i - first], &mut b[i - first], &mut c[i - first]);
        }
    };
    if serial(picked.len(), chunk) {
        run(0, a, b, c);
    } else {
        let parts = a.par_chunks_mut(chunk).zip(b.par_chunks_mut(chunk)).zip(c.par_chunks_mut(chunk));
        parts.enumerate().for_each(|(k, ((a, b), c))| run(k * chunk, a, b, c));
    }
}

/// The sum of what `f` makes of each chunk of `rows` rows, added in one order whatever the number of threads.
pub fn sum(rows: usize, chunk: usize, f: impl Fn(Range<usize>) -> f64 + Sync) -> f64 {
    chunks(rows, chunk, f).into_iter().sum()
}

/// The largest of what `f` says of each row, zero at least.
pub fn largest(rows: usize, chunk: usize, f: impl Fn(usize) -> f64 + Sync) -> f64 {
    chunks(rows, chunk, |range| range.fold(0.0f64, |m, i| m.max(f(i)))).into_iter().fold(0.0, f64::max)
}

/// What `f` makes of each chunk of `rows` rows, in order.
pub fn chunks<T: Send>(rows: usize, chunk: usize, f: impl Fn(Range<usize>) -> T + Sync) -> Vec<T> {
    let count = rows.div_ceil(chunk);
    let range = |c: usize| c * chunk..((c + 1) * chunk).min(rows);
    if serial(rows, chunk) { (0..count).map(|c| f(range(c))).collect() } else { (0..count).into_par_iter().map(|c| f(range(c))).collect() }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pool() -> rayon::ThreadPool {
        rayon::ThreadPoolBuilder::new().num_threads(2).build().expect("two threads")
    }

    #[test]
    fn threads_that_are_kept_awake_do_their_share_and_go_home() {
        let pool = pool();
        for rows in [WORTH - 1, WORTH] {
            let done = pool.install(|| awake(rows, || sum(10_000, 100, |range| range.len() as f64)));
            assert_eq!(done, 10_000.0);
        }
        assert_eq!(pool.install(|| sum(10_000, 100, |range| range.len() as f64)), 10_000.0);
    }

    #[test]
    fn a_panic_lets_the_threads_go() {
        let pool = pool();
        let work = || pool.install(|| awake(WORTH, || panic!("on purpose")));
        assert!(std::panic::catch_unwind(std::panic::AssertUnwindSafe(work)).is_err());
        assert_eq!(pool.install(|| 7), 7);
    }
}
