//! A few elements side by side: one number of each, and arithmetic on all of them at once.
//!
//! The compiler turns the loops here into vector instructions. Lanes never mix, and no operation is
//! fused, so an element's result is the same to the last bit, independent of adjacent lanes and of
//! the processor.

use std::ops::{Add, AddAssign, Div, Mul, Sub};

/// Elements side by side.
pub(crate) const WIDTH: usize = 4;

/// One number of each of [`WIDTH`] elements.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C, align(32))]
pub(crate) struct Lanes(pub(crate) [f64; WIDTH]);

/// A vector of three, of each element.
pub(crate) type Triple = [Lanes; 3];

/// A matrix of three by three, of each element.
pub(crate) type Square = [Triple; 3];

pub(crate) const ZERO: Lanes = Lanes([0.0; WIDTH]);
pub(crate) const ONE: Lanes = Lanes([1.0; WIDTH]);
pub(crate) const NOTHING: Square = [[ZERO; 3]; 3];
pub(crate) const IDENTITY: Square = [[ONE, ZERO, ZERO], [ZERO, ONE, ZERO], [ZERO, ZERO, ONE]];

impl Lanes {
    #[inline(always)]
    pub(crate) fn all(value: f64) -> Self {
        Self([value; WIDTH])
    }

    #[inline(always)]
    pub(crate) fn sqrt(mut self) -> Self {
        for value in &mut self.0 {
            *value = value.sqrt();
        }
        self
    }

    #[inline(always)]
    pub(crate) fn cbrt(mut self) -> Self {
        for value in &mut self.0 {
            *value = value.cbrt();
        }
        self
    }

    #[inline(always)]
    pub(crate) fn abs(mut self) -> Self {
        for value in &mut self.0 {
            *value = value.abs();
        }
        self
    }

    /// Whether every number is at most the other.
    #[inline(always)]
    pub(crate) fn all_at_most(self, other: Self) -> bool {
        let mut all = true;
        for k in 0..WIDTH {
            all &= self.0[k] <= other.0[k];
        }
        all
    }

    /// `yes` where `self` is at most `other`, else `no`, also where either is not a number.
    #[inline(always)]
    pub(crate) fn at_most(self, other: Self, yes: Self, mut no: Self) -> Self {
        for k in 0..WIDTH {
            no.0[k] = if self.0[k] <= other.0[k] { yes.0[k] } else { no.0[k] };
        }
        no
    }
}

macro_rules! operation {
    ($trait:ident, $method:ident, $assign:tt) => {
        impl $trait for Lanes {
            type Output = Self;

            #[inline(always)]
            fn $method(mut self, other: Self) -> Self {
                for k in 0..WIDTH {
                    self.0[k] $assign other.0[k];
                }
                self
            }
        }
    };
}

operation!(Add, add, +=);
operation!(Sub, sub, -=);
operation!(Mul, mul, *=);
operation!(Div, div, /=);

impl AddAssign for Lanes {
    #[inline(always)]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

#[inline(always)]
pub(crate) fn dot(a: &Triple, b: &Triple) -> Lanes {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[inline(always)]
pub(crate) fn scaled(a: &Triple, factor: Lanes) -> Triple {
    [a[0] * factor, a[1] * factor, a[2] * factor]
}

/// The determinant of three rows or columns.
#[inline(always)]
pub(crate) fn determinant(m: &Square) -> Lanes {
    let [a, b, c] = m;
    a[0] * (b[1] * c[2] - b[2] * c[1])
        + a[1] * (b[2] * c[0] - b[0] * c[2])
        + a[2] * (b[0] * c[1] - b[1] * c[0])
}

/// M x.
#[inline(always)]
pub(crate) fn product(m: &Square, x: &Triple) -> Triple {
    [dot(&m[0], x), dot(&m[1], x), dot(&m[2], x)]
}

/// 1 / a.
#[inline(always)]
pub(crate) fn inverse(a: &Triple) -> Triple {
    [ONE / a[0], ONE / a[1], ONE / a[2]]
}

/// Adds `a ⊗ b`.
#[inline(always)]
pub(crate) fn add_outer(sum: &mut Square, a: &Triple, b: &Triple) {
    for i in 0..3 {
        for j in 0..3 {
            sum[i][j] += a[i] * b[j];
        }
    }
}

/// Adds `factor` a.
#[inline(always)]
pub(crate) fn add_scaled(sum: &mut Triple, a: &Triple, factor: Lanes) {
    for i in 0..3 {
        sum[i] += a[i] * factor;
    }
}
