//! What the program was built for, and whether this processor is that.

/// What is missing on this processor, if anything.
#[cfg(all(target_arch = "x86_64", target_feature = "avx2"))]
pub(super) fn lacking() -> Option<&'static str> {
    // The detection of the standard library takes what the build assumes for granted.
    let cpu = raw_cpuid::CpuId::new();
    let basic = cpu.get_feature_info().is_some_and(|f| f.has_oxsave() && f.has_avx() && f.has_fma() && f.has_f16c() && f.has_movbe());
    let extended = cpu.get_extended_feature_info().is_some_and(|f| f.has_avx2() && f.has_bmi1() && f.has_bmi2());
    (!(basic && extended)).then_some("AVX2 and FMA")
}

/// Built for every processor of its kind.
#[cfg(not(all(target_arch = "x86_64", target_feature = "avx2")))]
pub(super) fn lacking() -> Option<&'static str> {
    None
}
