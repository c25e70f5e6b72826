//! Loops over columns, serial when they are short or when there is one thread.
//!
//! Each call of the closure writes only its own row, so the result does not depend on the number
//! of threads. A loop is split only if every thread gets at least one chunk: a parallel region pays from
//! about 30 us of work.
use rayon::prelude::*;

fn serial(rows: usize, chunk: usize) -> bool {
    rows < 2 * chunk || rayon::current_num_threads() == 1
}

/// Runs `f` on every pair of rows.
pub fn zip2<A: Send, B: Sync>(a: &mut [A], b: &[B], chunk: usize, f: impl Fn(&mut A, &B) + Sync) {
    assert_eq!(a.len(), b.len(), "columns of one table have one length");
    if serial(a.len(), chunk) {
        a.iter_mut().zip(b).for_each(|(a, b)| f(a, b));
    } else {
        a.par_chunks_mut(chunk).zip(b.par_chunks(chunk)).for_each(|(a, b)| a.iter_mut().zip(b).for_each(|(a, b)| f(a, b)));
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

/// Runs `f` on every triple of rows of which the first and the last are written.
pub fn zip3_mut<A: Send, B: Sync, C: Send>(a: &mut [A], b: &[B], c: &mut [C], chunk: usize, f: impl Fn(&mut A, &B, &mut C) + Sync) {
    assert!(a.len() == b.len() && b.len() == c.len(), "columns of one table have one length");
    if serial(a.len(), chunk) {
        a.iter_mut().zip(b).zip(c).for_each(|((a, b), c)| f(a, b, c));
    } else {
        a.par_chunks_mut(chunk)
            .zip(b.par_chunks(chunk))
            .zip(c.par_chunks_mut(chunk))
            .for_each(|((a, b), c)| a.iter_mut().zip(b).zip(c).for_each(|((a, b), c)| f(a, b, c)));
    }
}
