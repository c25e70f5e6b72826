//! Loops over columns, serial when they are short or when there is one thread.
//!
//! Each call of the closure writes only its own row, so the result does not depend on the number
//! of threads. A loop is split only if every thread gets at least one chunk: a parallel region pays from
//! about 30 us of work.
use rayon::prelude::*;
use std::ops::Range;

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

/// Those of the picked rows (in order) that lie in a range.
fn picked_in(picked: &[u32], rows: Range<usize>) -> &[u32] {
    &picked[picked.partition_point(|i| (*i as usize) < rows.start)..picked.partition_point(|i| (*i as usize) < rows.end)]
}

/// Runs `f` on the number of every picked row (in order) and the row of two columns that are written.
pub fn picked2<A: Send, B: Send>(a: &mut [A], b: &mut [B], picked: &[u32], chunk: usize, f: impl Fn(usize, &mut A, &mut B) + Sync) {
    assert_eq!(a.len(), b.len(), "columns of one table have one length");
    let run = |first: usize, a: &mut [A], b: &mut [B]| {
        for &i in picked_in(picked, first..first + a.len()) {
            let k = i as usize - first;
            f(i as usize, &mut a[k], &mut b[k]);
        }
    };
    if serial(picked.len(), chunk) {
        run(0, a, b);
    } else {
        a.par_chunks_mut(chunk).zip(b.par_chunks_mut(chunk)).enumerate().for_each(|(k, (a, b))| run(k * chunk, a, b));
    }
}

/// Runs `f` on the number of every picked row (in order) and the row of three columns that are written.
pub fn picked3<A: Send, B: Send, C: Send>(
    a: &mut [A],
    b: &mut [B],
    c: &mut [C],
    picked: &[u32],
    chunk: usize,
    f: impl Fn(usize, &mut A, &mut B, &mut C) + Sync,
) {
    assert!(a.len() == b.len() && b.len() == c.len(), "columns of one table have one length");
    let run = |first: usize, a: &mut [A], b: &mut [B], c: &mut [C]| {
        for &i in picked_in(picked, first..first + a.len()) {
            let k = i as usize - first;
            f(i as usize, &mut a[k], &mut b[k], &mut c[k]);
        }
    };
    if serial(picked.len(), chunk) {
        run(0, a, b, c);
    } else {
        let parts = a.par_chunks_mut(chunk).zip(b.par_chunks_mut(chunk)).zip(c.par_chunks_mut(chunk));
        parts.enumerate().for_each(|(k, ((a, b), c))| run(k * chunk, a, b, c));
    }
}

/// What `f` makes of each chunk of `rows` rows, in order.
pub fn chunks<T: Send>(rows: usize, chunk: usize, f: impl Fn(Range<usize>) -> T + Sync) -> Vec<T> {
    let count = rows.div_ceil(chunk);
    let range = |c: usize| c * chunk..((c + 1) * chunk).min(rows);
    if serial(rows, chunk) { (0..count).map(|c| f(range(c))).collect() } else { (0..count).into_par_iter().map(|c| f(range(c))).collect() }
}
