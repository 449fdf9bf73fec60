//! Patches that come little by little: a share of their samples, spread evenly.

/// Place of a sample in the order in which its patch fades in; the twin of this is `glsl`'s `bitfieldReverse(sample) ^ …`, integers
/// only.
///
/// Samples are stored along a curve through space. The reversed bits of 0, 1, 2 … (van der Corput 1935) fill the range of u32
/// evenly from the start, so those below any limit lie evenly along the curve, which a hash of the number does not give. The
/// exclusive or with a hash of the node keeps that and lets neighbouring patches differ.
pub fn rank(node: u32, sample: u32) -> u32 {
    sample.reverse_bits() ^ hash(node)
}

/// The finaliser of MurmurHash3 (Appleby 2011).
fn hash(node: u32) -> u32 {
    let mut h = node.wrapping_add(1);
    h = (h ^ (h >> 16)).wrapping_mul(0x85eb_ca6b);
    h = (h ^ (h >> 13)).wrapping_mul(0xc2b2_ae35);
    h ^ (h >> 16)
}

/// Number of a patch's samples with [`rank`] ≤ `limit`; at most log₂ `samples` + 2 off the same share of them.
pub fn shown(node: u32, samples: u32, limit: u32) -> u32 {
    if limit == u32::MAX {
        return samples;
    }
    // The highest bits of a rank are the lowest of the number. Ranks at most the limit share its first k bits and have 0 for 1 in
    // the next, for one k; or are the limit. Each time the numbers are those of one residue.
    let mask = hash(node);
    let alike = |bits: u32, ranks: u32| {
        let first = (ranks ^ mask).reverse_bits() as u64 & ((1u64 << bits) - 1);
        (samples as u64).saturating_sub(first).div_ceil(1u64 << bits) as u32
    };
    let below = (0..32).filter(|k| limit >> (31 - k) & 1 == 1).map(|k| alike(k + 1, limit ^ (1 << (31 - k))));
    below.sum::<u32>() + alike(32, limit)
}

/// The limit for a share of a patch, more than 0.
pub(super) fn limit(share: f32) -> u32 {
    // 1 × 2³² − 1 is the largest u32, and every rank is within it; conversions saturate.
    (share as f64 * 4_294_967_296.0 - 1.0) as u32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_are_those_of_counting() {
        for node in [0, 1, 17, 99_999] {
            for samples in [0, 1, 2, 3, 100, 512, 4097] {
                for limit in [0, 1, 1 << 20, 0x8000_0000, 0x7fff_ffff, 0xdead_beef, u32::MAX - 1, u32::MAX, hash(node)]
                {
                    let counted = (0..samples).filter(|i| rank(node, *i) <= limit).count() as u32;
                    assert_eq!(shown(node, samples, limit), counted, "{node}, {samples}, {limit:#x}");
                    let even = samples as f64 * (limit as f64 + 1.0) / 4_294_967_296.0;
                    assert!((counted as f64 - even).abs() <= (samples.max(1) as f64).log2() + 2.0);
                }
            }
        }
    }

    #[test]
    fn shares_are_limits() {
        assert_eq!(limit(1.0), u32::MAX);
        assert_eq!(limit(0.5), u32::MAX / 2);
        assert_eq!(limit(1e-30), 0);
    }

    #[test]
    fn a_share_is_spread_over_the_patch() {
        // Of 64 consecutive samples, any aligned run of 8 has one of an eighth.
        for run in 0..8 {
            let count = (8 * run..8 * run + 8).filter(|i| rank(5, *i) <= limit(0.125)).count();
            assert_eq!(count, 1);
        }
    }
}
