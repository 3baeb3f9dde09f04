//! A small random generator whose bits never change.
//!
//! A published design must come out the same on every platform and after every upgrade, so the
//! generator is written out here: xoshiro256++ 1.0 seeded by SplitMix64, both by Blackman and
//! Vigna and in the public domain.

/// xoshiro256++.
pub(crate) struct Rng([u64; 4]);

impl Rng {
    /// State from four outputs of SplitMix64, as its authors advise; it is never all zero.
    pub(crate) fn new(seed: u64) -> Self {
        let mut state = seed;
        Self(std::array::from_fn(|_| split_mix(&mut state)))
    }

    /// A generator for another use of the same seed: `salt` distinguishes the uses.
    pub(crate) fn salted(seed: u64, salt: u64) -> Self {
        Self::new(seed ^ mixed(salt))
    }

    fn next(&mut self) -> u64 {
        let s = &mut self.0;
        let out = s[0].wrapping_add(s[3]).rotate_left(23).wrapping_add(s[0]);
        let t = s[1] << 17;
        s[2] ^= s[0];
        s[3] ^= s[1];
        s[1] ^= s[2];
        s[0] ^= s[3];
        s[2] ^= t;
        s[3] = s[3].rotate_left(45);
        out
    }

    /// A whole number below `bound`, each equally likely (Lemire's multiplication with rejection).
    pub(crate) fn below(&mut self, bound: u32) -> u32 {
        loop {
            let [high, low] = halves(u64::from(halves(self.next())[0]) * u64::from(bound));
            // Fewer than `bound` words are unfair, so the slow remainder is seldom needed.
            if low >= bound || low >= bound.wrapping_neg() % bound {
                return high;
            }
        }
    }

    /// A real number in the open interval (0, 1): the centre of one of 2^52 equal cells.
    #[expect(clippy::cast_precision_loss, reason = "52 bits fit the mantissa")]
    pub(crate) fn unit(&mut self) -> f64 {
        const CELL: f64 = 1.0 / (1_u64 << 52) as f64;
        ((self.next() >> 12) as f64 + 0.5) * CELL
    }
}

fn split_mix(state: &mut u64) -> u64 {
    *state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let mut z = *state;
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// A word whose bits all depend on all bits of `word`.
pub(crate) fn mixed(mut word: u64) -> u64 {
    split_mix(&mut word)
}

/// High and low half of a word.
#[expect(clippy::cast_possible_truncation, reason = "each half is 32 bits")]
fn halves(word: u64) -> [u32; 2] {
    [(word >> 32) as u32, word as u32]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// First outputs of the reference implementation of SplitMix64 for the seed 1234567.
    #[test]
    fn split_mix_matches_its_reference() {
        let mut state = 1_234_567;
        let outputs: [u64; 3] = std::array::from_fn(|_| split_mix(&mut state));
        assert_eq!(
            outputs,
            [6_457_827_717_110_365_317, 3_203_168_211_198_807_973, 9_817_491_932_198_370_423]
        );
    }

    /// First outputs of the reference implementation of xoshiro256++ from the state 1, 2, 3, 4.
    #[test]
    fn xoshiro_matches_its_reference() {
        let mut rng = Rng([1, 2, 3, 4]);
        let outputs: [u64; 4] = std::array::from_fn(|_| rng.next());
        assert_eq!(outputs, [41_943_041, 58_720_359, 3_588_806_011_781_223, 3_591_011_842_654_386]);
    }

    #[test]
    fn bounded_numbers_are_even_and_in_bounds() {
        let mut rng = Rng::new(7);
        let mut counts = [0_u32; 6];
        for _ in 0..60_000 {
            counts[rng.below(6) as usize] += 1;
        }
        // 10,000 ± 91 expected; six standard deviations.
        assert!(counts.iter().all(|c| c.abs_diff(10_000) < 550), "{counts:?}");
    }

    /// A bound just above 2^31 rejects nearly half of all words; without that, low numbers double.
    #[test]
    fn bounded_numbers_are_even_for_a_large_bound() {
        let bound = 3 << 30;
        let mut rng = Rng::new(11);
        let low = (0..30_000).filter(|_| rng.below(bound).is_multiple_of(3)).count();
        assert!(low.abs_diff(10_000) < 500, "{low}");
    }

    #[test]
    fn unit_numbers_stay_inside_the_open_interval() {
        let extremes = [Rng([0, 0, 0, 0]), Rng([u64::MAX, 0, 0, 0])];
        for mut rng in extremes {
            let u = rng.unit();
            assert!(u > 0.0 && u < 1.0, "{u}");
        }
    }
}
