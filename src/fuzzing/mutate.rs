//! Damage to inputs, blind but repeatable: what any machine can try without a fuzzer.

use crate::math::random::Rng;

/// Numbers at the edges of what formats and types hold.
const NUMBERS: [&str; 14] = [
    "0",
    "-1",
    "1",
    "255",
    "65535",
    "65536",
    "4294967295",
    "18446744073709551615",
    "1e308",
    "-1e-320",
    "nan",
    "-inf",
    "1e39",
    "",
];

/// One to four changes of `input`; `other` is what a piece may be taken from.
pub fn mutated(input: &[u8], other: &[u8], rng: &mut Rng) -> Vec<u8> {
    let mut data = input.to_vec();
    for _ in 0..=below(rng, 3) {
        match below(rng, 7) {
            0 => change(&mut data, rng, |byte, rng| byte ^ 1 << below(rng, 7)),
            1 => change(&mut data, rng, |_, rng| rng.next_u32() as u8),
            2 => change(&mut data, rng, |_, rng| [0, 1, 0x7f, 0x80, 0xff][below(rng, 4)]),
            3 => drop(data.drain(piece(&data, rng))),
            4 => {
                let copy = data[piece(&data, rng)].to_vec();
                insert(&mut data, &copy, rng);
            }
            5 => {
                let copy = other[piece(other, rng)].to_vec();
                insert(&mut data, &copy, rng);
            }
            6 => number(&mut data, rng),
            _ => {
                let end = below(rng, data.len());
                data.truncate(end);
            }
        }
    }
    make_checksums_good(&mut data);
    data
}

/// Up to and including `most`.
fn below(rng: &mut Rng, most: usize) -> usize {
    rng.next_u32() as usize % (most + 1)
}

fn change(data: &mut [u8], rng: &mut Rng, to: impl FnOnce(u8, &mut Rng) -> u8) {
    if !data.is_empty() {
        let at = below(rng, data.len() - 1);
        data[at] = to(data[at], rng);
    }
}

/// Some place and a short length.
fn piece(data: &[u8], rng: &mut Rng) -> std::ops::Range<usize> {
    let start = below(rng, data.len());
    let length = 1 << below(rng, 6);
    start..data.len().min(start + below(rng, length))
}

fn insert(data: &mut Vec<u8>, what: &[u8], rng: &mut Rng) {
    let at = below(rng, data.len());
    data.splice(at..at, what.iter().copied());
}

/// A number somewhere in the text becomes another.
fn number(data: &mut Vec<u8>, rng: &mut Rng) {
    let from = below(rng, data.len());
    let is_digit = |b: &u8| b.is_ascii_digit();
    let Some(start) = data[from..].iter().position(is_digit).map(|i| from + i) else { return };
    let length = data[start..].iter().take_while(|b| is_digit(b)).count();
    data.splice(start..start + length, NUMBERS[below(rng, NUMBERS.len() - 1)].bytes());
}

/// The chunks of PNG pictures get the checksums that they need to be looked at.
fn make_checksums_good(data: &mut [u8]) {
    const MARK: &[u8] = b"\x89PNG\r\n\x1a\n";
    let Some(start) = data.windows(MARK.len()).position(|w| w == MARK) else { return };
    let mut rest = &mut data[start + MARK.len()..];
    while let Some((length, _)) = rest.split_first_chunk::<4>() {
        let end = 8usize.saturating_add(u32::from_be_bytes(*length) as usize);
        let Some(chunk) = rest.get(4..end) else { return };
        let crc = crc32(chunk);
        let Some(place) = rest.get_mut(end..end + 4) else { return };
        place.copy_from_slice(&crc.to_be_bytes());
        rest = &mut rest[end + 4..];
    }
}

fn crc32(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0u32, |crc, &byte| {
        (0..8).fold(
            crc ^ u32::from(byte),
            |c, _| {
                if c & 1 == 1 { c >> 1 ^ 0xedb8_8320 } else { c >> 1 }
            },
        )
    })
}
