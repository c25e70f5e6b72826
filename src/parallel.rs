//! Loops over columns, serial when they are short or when there is one thread.
use rayon::prelude::*;

/// Runs `f` on every triple; splits into chunks of `chunk` when there are threads to use. Each
/// call writes only its own rows, so the result does not depend on the number of threads.
pub fn zip3<A: Send, B: Sync, C: Send>(a: &mut [A], b: &[B], c: &mut [C], chunk: usize, f: impl Fn(&mut A, &B, &mut C) + Sync) {
    assert!(a.len() == b.len() && b.len() == c.len(), "columns of one table have one length");
    if a.len() < 2 * chunk || rayon::current_num_threads() == 1 {
        for ((a, b), c) in a.iter_mut().zip(b).zip(c) {
            f(a, b, c);
        }
    } else {
        a.par_chunks_mut(chunk).zip(b.par_chunks(chunk)).zip(c.par_chunks_mut(chunk)).for_each(|((a, b), c)| {
            for ((a, b), c) in a.iter_mut().zip(b).zip(c) {
                f(a, b, c);
            }
        });
    }
}
