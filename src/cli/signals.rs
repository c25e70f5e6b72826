//! Ctrl-C and the wish of the system to end the program.
use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::flag;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// Lets the first SIGINT or SIGTERM set `stop`, so that the run ends in order; a SIGINT after that ends
/// the program at once with 130. A SIGTERM does not: batch systems send several. A hangup is left alone,
/// so that `nohup` works.
pub(super) fn catch(stop: &Arc<AtomicBool>) {
    catch_interrupt(stop);
    let _ = flag::register(SIGTERM, Arc::clone(stop));
}

/// The same for SIGINT alone: whoever takes `stop` back waits for the next first one.
pub(super) fn catch_interrupt(stop: &Arc<AtomicBool>) {
    // Where no handler can be set, signals end the program as ever.
    let _ = flag::register_conditional_shutdown(SIGINT, 130, Arc::clone(stop));
    let _ = flag::register(SIGINT, Arc::clone(stop));
}
