//! What tests of structures in files have in common.

use std::fmt::Debug;

use surfel::Error;

/// FNV-1a, 64 bits.
pub fn fnv(bytes: &[u8]) -> u64 {
    bytes.iter().fold(0xcbf2_9ce4_8422_2325, |hash, b| (hash ^ *b as u64).wrapping_mul(0x0100_0000_01b3))
}

/// The sum over the first `end` bytes, put behind them.
pub fn signed_at(mut bytes: Vec<u8>, end: usize) -> Vec<u8> {
    let sum = fnv(&bytes[..end]);
    bytes[end..end + 8].copy_from_slice(&sum.to_le_bytes());
    bytes
}

/// The sum over all but the last eight bytes, put there.
pub fn signed(bytes: Vec<u8>) -> Vec<u8> {
    let end = bytes.len() - 8;
    signed_at(bytes, end)
}

/// Every cut, every altered byte, and what is longer is refused, and so are counts that no memory holds, at these places: the
/// file ends first. Errors say that they are of file `name`, and where.
pub fn every_byte_counts<T: Debug>(
    name: &str,
    bytes: &[u8],
    counts: &[usize],
    read: impl Fn(&[u8]) -> Result<T, Error>,
) {
    for at in 0..bytes.len() {
        let error = read(&bytes[..at]).expect_err("cut short").to_string();
        assert!(error.starts_with(&format!("{name} at byte ")), "cut at {at}: {error}");
        for bit in [1, 0x80] {
            let mut altered = bytes.to_vec();
            altered[at] ^= bit;
            assert!(read(&altered).is_err(), "byte {at} ^ {bit}");
        }
    }
    let longer = [bytes, &[0]].concat();
    assert!(read(&longer).expect_err("longer").to_string().contains("after the end"));
    for &at in counts {
        let mut huge = bytes.to_vec();
        huge[at..at + 4].copy_from_slice(&u32::MAX.to_le_bytes());
        assert!(read(&huge).expect_err("huge").to_string().contains("too early"));
    }
}
