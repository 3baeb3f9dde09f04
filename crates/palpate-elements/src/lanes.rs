//! A few elements side by side: one number of each, and arithmetic on all of them at once.
//!
//! The compiler turns the loops here into vector instructions. Lanes never mix, and no operation is
//! fused, so an element's result is the same to the last bit whatever lies beside it and whatever
//! the processor.

use std::array::from_fn;
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
    pub(crate) fn map(self, function: impl Fn(f64) -> f64) -> Self {
        Self(self.0.map(function))
    }

    #[inline(always)]
    pub(crate) fn sqrt(self) -> Self {
        self.map(f64::sqrt)
    }

    #[inline(always)]
    pub(crate) fn abs(self) -> Self {
        self.map(f64::abs)
    }

    /// `yes` where the condition on `self` and `other` holds, else `no`.
    #[inline(always)]
    pub(crate) fn choose(
        self,
        other: Self,
        condition: impl Fn(f64, f64) -> bool,
        yes: Self,
        no: Self,
    ) -> Self {
        Self(from_fn(|k| if condition(self.0[k], other.0[k]) { yes.0[k] } else { no.0[k] }))
    }
}

macro_rules! operation {
    ($trait:ident, $method:ident, $symbol:tt) => {
        impl $trait for Lanes {
            type Output = Self;

            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                Self(from_fn(|k| self.0[k] $symbol other.0[k]))
            }
        }
    };
}

operation!(Add, add, +);
operation!(Sub, sub, -);
operation!(Mul, mul, *);
operation!(Div, div, /);

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
    a.map(|x| x * factor)
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
    m.each_ref().map(|row| dot(row, x))
}

/// Adds `a ⊗ b`.
#[inline(always)]
pub(crate) fn add_outer(sum: &mut Square, a: &Triple, b: &Triple) {
    for (row, x) in sum.iter_mut().zip(a) {
        for (entry, y) in row.iter_mut().zip(b) {
            *entry += *x * *y;
        }
    }
}

/// Adds `factor` a.
#[inline(always)]
pub(crate) fn add_scaled(sum: &mut Triple, a: &Triple, factor: Lanes) {
    for (entry, x) in sum.iter_mut().zip(a) {
        *entry += *x * factor;
    }
}
