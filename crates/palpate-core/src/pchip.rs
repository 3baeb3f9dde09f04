//! Monotone piecewise cubic interpolation after Fritsch and Butland.
//!
//! | name here | quantity |
//! |---|---|
//! | `s`, `y` | knots in ascending order and their ordinates |
//! | h, δ | width of a segment and its slope Δy/h |
//! | slope | derivative of the interpolant at a knot |
//!
//! Inside, the slope is the harmonic mean of the neighbouring δ with weights 2h₁ + h₀ and h₁ + 2h₀,
//! or 0 where they differ in sign. At an end it is that of the parabola through three points, cut
//! back to keep the sign of δ and to three times its size.
#![expect(clippy::inline_always, reason = "only what is inlined gets a kernel's instructions")]

use crate::knots::Knots;

/// Slopes at the knots of a branch, with room for what they are made of.
#[derive(Default)]
pub(crate) struct Slopes {
    widths: Vec<f64>,
    chords: Vec<f64>,
    found: Vec<f64>,
}

impl Slopes {
    /// Slopes at the knots `s` with ordinates `y`.
    #[inline(always)]
    pub(crate) fn at_knots(&mut self, s: &[f64], y: &[f64]) -> &[f64] {
        let Self { widths, chords, found } = self;
        widths.clear();
        widths.extend(s.windows(2).map(|s| s[1] - s[0]));
        chords.clear();
        chords.extend(y.windows(2).zip(&*widths).map(|(y, h)| (y[1] - y[0]) / h));
        found.clear();
        // A branch of one knot has moved by less than a segment needs, and has no slope.
        let Some(last) = widths.len().checked_sub(1) else { return found };
        if last == 0 {
            found.extend([chords[0]; 2]);
            return found;
        }
        found.push(end((widths[0], widths[1]), (chords[0], chords[1])));
        let pairs = widths.windows(2).zip(chords.windows(2));
        found.extend(pairs.map(|(h, d)| inside((h[0], h[1]), (d[0], d[1]))));
        found.push(end((widths[last], widths[last - 1]), (chords[last], chords[last - 1])));
        found
    }
}

/// Slope between two segments.
#[expect(clippy::needless_bitwise_bool, reason = "a branch here is taken at random")]
#[inline(always)]
fn inside((h0, h1): (f64, f64), (d0, d1): (f64, f64)) -> f64 {
    let (w0, w1) = (2.0 * h1 + h0, h1 + 2.0 * h0);
    let mean = (w0 + w1) / (w0 / d0 + w1 / d1);
    let same_sign = ((d0 > 0.0) & (d1 > 0.0)) | ((d0 < 0.0) & (d1 < 0.0));
    if same_sign { mean } else { 0.0 }
}

/// Slope at an end, whose segment comes first.
fn end(h: (f64, f64), d: (f64, f64)) -> f64 {
    let (of_first, of_second) = end_shares(h, d);
    of_first * d.0 + of_second * d.1
}

/// The shares of the two δ in the slope at an end.
fn end_shares((h0, h1): (f64, f64), (d0, d1): (f64, f64)) -> (f64, f64) {
    let (of_first, of_second) = ((2.0 * h0 + h1) / (h0 + h1), -h0 / (h0 + h1));
    let slope = of_first * d0 + of_second * d1;
    if d0 == 0.0 || slope.signum() != d0.signum() {
        (0.0, 0.0)
    } else if d0.signum() != d1.signum() && slope.abs() > 3.0 * d0.abs() {
        (3.0, 0.0)
    } else {
        (of_first, of_second)
    }
}

/// Coefficients of the cubic over a segment of width `h`, in powers of the share of the way.
///
/// Slopes beyond the range of numbers make an infinite constant, and with it an infinite score.
#[inline]
pub(crate) fn coefficients(h: f64, (y0, y1): (f64, f64), (m0, m1): (f64, f64)) -> [f64; 4] {
    let (rise, d0, d1) = (y1 - y0, m0 * h, m1 * h);
    let found = [y0, d0, 3.0 * rise - 2.0 * d0 - d1, d0 + d1 - 2.0 * rise];
    if found[2].is_finite() && found[3].is_finite() {
        found
    } else {
        [f64::INFINITY, 0.0, 0.0, 0.0]
    }
}

/// The gradient with respect to the ordinates at the knots, gathered from interpolated values.
pub(crate) struct Backward<'a> {
    legs: Vec<Leg<'a>>,
}

/// One branch: its knots, and the gradient with respect to their ordinates and slopes.
struct Leg<'a> {
    knots: &'a Knots,
    y: Vec<f64>,
    by_y: Vec<f64>,
    by_slope: Vec<f64>,
}

impl<'a> Backward<'a> {
    pub(crate) fn new(legs: &'a [Knots], sim: &[f64]) -> Self {
        let leg = |knots: &'a Knots| Leg {
            knots,
            y: knots.at.iter().map(|&i| sim[i]).collect(),
            by_y: vec![0.0; knots.at.len()],
            by_slope: vec![0.0; knots.at.len()],
        };
        Self { legs: legs.iter().map(leg).collect() }
    }

    /// Adds the derivative `by_value` with respect to the value at a `share` of the way behind `knot`.
    pub(crate) fn add(&mut self, leg: usize, knot: usize, share: f64, by_value: f64) {
        let leg = &mut self.legs[leg];
        if share == 0.0 {
            leg.by_y[knot] += by_value;
            return;
        }
        let (t, rest) = (share, 1.0 - share);
        let h = leg.knots.s[knot + 1] - leg.knots.s[knot];
        leg.by_y[knot] += rest * rest * (1.0 + 2.0 * t) * by_value;
        leg.by_y[knot + 1] += t * t * (3.0 - 2.0 * t) * by_value;
        leg.by_slope[knot] += rest * rest * t * h * by_value;
        leg.by_slope[knot + 1] -= t * t * rest * h * by_value;
    }

    /// Adds everything to the gradient with respect to the values of the path.
    pub(crate) fn into_gradient(self, gradient: &mut [f64]) {
        for mut leg in self.legs {
            leg.through_slopes();
            for (&at, by_y) in leg.knots.at.iter().zip(leg.by_y) {
                gradient[at] += by_y;
            }
        }
    }
}

impl Leg<'_> {
    /// Passes the gradient with respect to the slopes on to the ordinates.
    fn through_slopes(&mut self) {
        let (s, y) = (&self.knots.s, &self.y);
        let last = s.len() - 1;
        let width = |k: usize| s[k + 1] - s[k];
        let chord = |k: usize| (y[k + 1] - y[k]) / width(k);
        let mut by_chord = vec![0.0; last];
        if last == 0 {
            return;
        }
        if last == 1 {
            by_chord[0] = self.by_slope[0] + self.by_slope[1];
        } else {
            for (at, first, second) in [(0, 0, 1), (last, last - 1, last - 2)] {
                let (h, d) = ((width(first), width(second)), (chord(first), chord(second)));
                let (of_first, of_second) = end_shares(h, d);
                by_chord[first] += of_first * self.by_slope[at];
                by_chord[second] += of_second * self.by_slope[at];
            }
            for k in 1..last {
                let (h0, h1, d0, d1) = (width(k - 1), width(k), chord(k - 1), chord(k));
                let mean = inside((h0, h1), (d0, d1));
                if mean != 0.0 {
                    let (w0, w1) = (2.0 * h1 + h0, h1 + 2.0 * h0);
                    by_chord[k - 1] += self.by_slope[k] * (mean / d0).powi(2) * w0 / (w0 + w1);
                    by_chord[k] += self.by_slope[k] * (mean / d1).powi(2) * w1 / (w0 + w1);
                }
            }
        }
        for (k, by_chord) in by_chord.into_iter().enumerate() {
            self.by_y[k] -= by_chord / width(k);
            self.by_y[k + 1] += by_chord / width(k);
        }
    }
}
