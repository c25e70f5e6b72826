//! Numbers that a kernel works on: one record at a time (`f64`) or four (`wide::f64x4`).
//!
//! Only operations that IEEE 754 rounds correctly are offered, and no fused multiply-add, so every
//! lane gives the bits of the scalar kernel.
use std::ops::{Add, BitAnd, BitOr, Div, Mul, Neg, Sub};
use wide::f64x4;

/// A number or a vector of numbers.
pub trait Lane: Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self> + Neg<Output = Self> {
    /// Outcome of a comparison.
    type Mask: Copy + BitAnd<Output = Self::Mask> + BitOr<Output = Self::Mask>;
    /// Numbers held.
    const WIDTH: usize;
    /// The same value in every lane.
    fn splat(value: f64) -> Self;
    /// One value per lane, from a function of the lane number.
    fn from_fn(f: impl FnMut(usize) -> f64) -> Self;
    /// The four columns of one row of four numbers per lane.
    fn rows(f: impl FnMut(usize) -> [f64; 4]) -> [Self; 4];
    /// The reverse of [`Lane::rows`]: hands out the row of four numbers of each lane.
    fn each_row(columns: [Self; 4], f: impl FnMut(usize, [f64; 4]));
    /// The value of one lane.
    fn lane(self, index: usize) -> f64;
    /// Square root.
    fn sqrt(self) -> Self;
    /// self < other.
    fn less(self, other: Self) -> Self::Mask;
    /// True if the mask is true in any lane.
    fn any(mask: Self::Mask) -> bool;
    /// `yes` where the mask is true, `no` elsewhere.
    fn pick(mask: Self::Mask, yes: Self, no: Self) -> Self;

    /// The smaller one.
    #[inline(always)]
    fn lower(self, other: Self) -> Self {
        Self::pick(self.less(other), self, other)
    }
    /// The larger one.
    #[inline(always)]
    fn upper(self, other: Self) -> Self {
        Self::pick(other.less(self), self, other)
    }
    /// Limited to an interval.
    #[inline(always)]
    fn within(self, low: Self, high: Self) -> Self {
        self.upper(low).lower(high)
    }
    /// Absolute value.
    #[inline(always)]
    fn magnitude(self) -> Self {
        self.upper(-self)
    }
}

impl Lane for f64 {
    type Mask = bool;
    const WIDTH: usize = 1;
    #[inline(always)]
    fn splat(value: f64) -> Self {
        value
    }
    #[inline(always)]
    fn from_fn(mut f: impl FnMut(usize) -> f64) -> Self {
        f(0)
    }
    #[inline(always)]
    fn rows(mut f: impl FnMut(usize) -> [f64; 4]) -> [f64; 4] {
        f(0)
    }
    #[inline(always)]
    fn each_row(columns: [f64; 4], mut f: impl FnMut(usize, [f64; 4])) {
        f(0, columns);
    }
    #[inline(always)]
    fn lane(self, _index: usize) -> f64 {
        self
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        f64::sqrt(self)
    }
    #[inline(always)]
    fn less(self, other: Self) -> bool {
        self < other
    }
    #[inline(always)]
    fn any(mask: bool) -> bool {
        mask
    }
    #[inline(always)]
    fn pick(mask: bool, yes: Self, no: Self) -> Self {
        if mask { yes } else { no }
    }
}

impl Lane for f64x4 {
    type Mask = f64x4;
    const WIDTH: usize = 4;
    #[inline(always)]
    fn splat(value: f64) -> Self {
        f64x4::splat(value)
    }
    #[inline(always)]
    fn from_fn(f: impl FnMut(usize) -> f64) -> Self {
        f64x4::new(std::array::from_fn(f))
    }
    #[inline(always)]
    fn rows(mut f: impl FnMut(usize) -> [f64; 4]) -> [f64x4; 4] {
        f64x4::transpose(std::array::from_fn(|lane| f64x4::new(f(lane))))
    }
    #[inline(always)]
    fn each_row(columns: [f64x4; 4], mut f: impl FnMut(usize, [f64; 4])) {
        f64x4::transpose(columns).into_iter().enumerate().for_each(|(lane, row)| f(lane, row.to_array()));
    }
    #[inline(always)]
    fn lane(self, index: usize) -> f64 {
        self.to_array()[index]
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        f64x4::sqrt(self)
    }
    #[inline(always)]
    fn less(self, other: Self) -> f64x4 {
        self.simd_lt(other)
    }
    #[inline(always)]
    fn any(mask: f64x4) -> bool {
        mask.any()
    }
    #[inline(always)]
    fn pick(mask: f64x4, yes: Self, no: Self) -> Self {
        mask.bitselect(yes, no)
    }
}

/// Splits `count` rows into groups of four for the vector kernel, and what is left over into single ones.
pub fn groups(count: usize) -> impl Iterator<Item = std::ops::Range<usize>> {
    let whole = count / f64x4::WIDTH * f64x4::WIDTH;
    (0..whole).step_by(f64x4::WIDTH).map(|k| k..k + f64x4::WIDTH).chain((whole..count).map(|k| k..k + 1))
}

/// A vector in space.
#[derive(Clone, Copy, Debug)]
pub struct V3<L> {
    /// First component.
    pub x: L,
    /// Second component.
    pub y: L,
    /// Third component.
    pub z: L,
}

impl<L: Lane> V3<L> {
    /// From three components.
    #[inline(always)]
    pub fn new(x: L, y: L, z: L) -> Self {
        V3 { x, y, z }
    }
    /// The zero vector.
    #[inline(always)]
    pub fn zero() -> Self {
        let o = L::splat(0.0);
        V3::new(o, o, o)
    }
    /// Scalar product.
    #[inline(always)]
    pub fn dot(self, o: Self) -> L {
        self.x * o.x + self.y * o.y + self.z * o.z
    }
    /// Vector product.
    #[inline(always)]
    pub fn cross(self, o: Self) -> Self {
        V3::new(self.y * o.z - self.z * o.y, self.z * o.x - self.x * o.z, self.x * o.y - self.y * o.x)
    }
    /// `yes` where the mask is true, `no` elsewhere.
    #[inline(always)]
    pub fn pick(mask: L::Mask, yes: Self, no: Self) -> Self {
        V3::new(L::pick(mask, yes.x, no.x), L::pick(mask, yes.y, no.y), L::pick(mask, yes.z, no.z))
    }
    /// A vector of each lane.
    #[inline(always)]
    pub fn gather(mut of: impl FnMut(usize) -> glam::DVec3) -> Self {
        let [x, y, z, _] = L::rows(|lane| {
            let v = of(lane);
            [v.x, v.y, v.z, 0.0]
        });
        V3::new(x, y, z)
    }
    /// Hands out the vector of each lane.
    #[inline(always)]
    pub fn each(self, mut f: impl FnMut(usize, glam::DVec3)) {
        L::each_row([self.x, self.y, self.z, L::splat(0.0)], |lane, [x, y, z, _]| f(lane, glam::DVec3::new(x, y, z)));
    }
    /// One lane as a plain vector.
    #[inline(always)]
    pub fn lane(self, index: usize) -> glam::DVec3 {
        glam::DVec3::new(self.x.lane(index), self.y.lane(index), self.z.lane(index))
    }
}

impl<L: Lane> Add for V3<L> {
    type Output = Self;
    #[inline(always)]
    fn add(self, o: Self) -> Self {
        V3::new(self.x + o.x, self.y + o.y, self.z + o.z)
    }
}

impl<L: Lane> Sub for V3<L> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, o: Self) -> Self {
        V3::new(self.x - o.x, self.y - o.y, self.z - o.z)
    }
}

impl<L: Lane> Mul<L> for V3<L> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, s: L) -> Self {
        V3::new(self.x * s, self.y * s, self.z * s)
    }
}

impl From<glam::DVec3> for V3<f64> {
    fn from(v: glam::DVec3) -> Self {
        V3::new(v.x, v.y, v.z)
    }
}
