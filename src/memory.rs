//! Memory: what a model takes and what the machine has.

/// Bytes of memory that an element of a generated structure takes while it runs, with its nodes, its neighbours in contact and
/// the states that are kept to go back to. Measured on braids of 1300 to 135 000 filament elements: 4.7 kB for
/// trusses, 6.2 kB for embedded elements and for beams, and 0.6 kB for the two states.
pub const PER_ELEMENT: u64 = 7000;

/// Memory of this machine, or of what it lends this program (bytes), where the system tells (Linux).
pub fn of_machine() -> Option<u64> {
    let info = std::fs::read_to_string("/proc/meminfo").ok()?;
    let total = kibibytes(&info, "MemTotal:")? << 10;
    let lent = std::fs::read_to_string("/sys/fs/cgroup/memory.max").ok().and_then(|t| t.trim().parse().ok());
    Some(lent.map_or(total, |lent: u64| lent.min(total)))
}

/// Largest memory of this program so far (bytes), where the system tells (Linux).
pub fn peak() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    Some(kibibytes(&status, "VmHWM:")? << 10)
}

fn kibibytes(text: &str, name: &str) -> Option<u64> {
    text.lines().find_map(|l| l.strip_prefix(name))?.split_whitespace().next()?.parse().ok()
}

/// A size for people: `27 MiB`, `3.5 GiB`.
pub fn text(bytes: u64) -> String {
    let mib = bytes as f64 / (1 << 20) as f64;
    if mib < 1000.0 { format!("{mib:.0} MiB") } else { format!("{:.1} GiB", mib / 1024.0) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_read_well() {
        assert_eq!([27 << 20, 7 << 29, 1 << 42].map(text), ["27 MiB", "3.5 GiB", "4096.0 GiB"]);
    }

    #[test]
    fn a_machine_has_more_than_a_program_takes() {
        if let (Some(machine), Some(peak)) = (of_machine(), peak()) {
            assert!(peak > 1 << 20 && machine > peak, "{machine} {peak}");
        }
    }
}
