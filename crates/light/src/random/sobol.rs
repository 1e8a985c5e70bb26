//! Owen-scrambled, index-shuffled Sobol points in four dimensions: one at a time, and two in the lanes of a vector. Source: Burley 2020, "Practical Hash-based Owen
//! Scrambling", JCGT 9(4).

use super::{mix, to_unit};
use crate::instruction_set;
use fearless_simd::{Simd, dispatch, f32x8, prelude::*, u32x8};

/// Multipliers of the scramble, and what tells dimensions and hashes apart.
const SCRAMBLE: [u32; 3] = [0x3d20_adea, 0x0552_6c56, 0x53a2_2864];
const DIMENSION: u32 = 0x85eb_ca6b;
const DIMENSIONS: [u32; 4] = [DIMENSION, DIMENSION.wrapping_mul(2), DIMENSION.wrapping_mul(3), DIMENSION.wrapping_mul(4)];

/// Owen scrambling of a bit-reversed number. Source: Vegdahl 2021, "Building a Better LK Hash" (constants).
#[inline]
fn scramble_reversed(mut x: u32, seed: u32) -> u32 {
    x ^= x.wrapping_mul(SCRAMBLE[0]);
    x = x.wrapping_add(seed);
    x = x.wrapping_mul((seed >> 16) | 1);
    x ^= x.wrapping_mul(SCRAMBLE[1]);
    x ^ x.wrapping_mul(SCRAMBLE[2])
}

/// The bits of a Sobol point, each dimension's in reversed order, before it is scrambled. `reversed_index`: its number within the net, bits reversed; it is shuffled by an Owen
/// scramble of 16 bits, which keeps every aligned block of 2ᵏ points together.
#[inline(always)]
fn shuffled(seed: u32, reversed_index: u16) -> [u32; 4] {
    let [high, low, ..] = scramble_reversed(u32::from(reversed_index), seed).to_le_bytes();
    let (low, high) = (REVERSED[0][usize::from(low)], REVERSED[1][usize::from(high)]);
    std::array::from_fn(|d| low[d] ^ high[d])
}

/// Four numbers in [0, 1): a point of the net that a seed makes.
#[inline]
pub(super) fn point(seed: u32, reversed_index: u16) -> [f32; 4] {
    let bits = shuffled(seed, reversed_index);
    std::array::from_fn(|d| to_unit(scramble_reversed(bits[d], mix(seed ^ DIMENSIONS[d])).reverse_bits()))
}

/// The same of two nets.
#[inline]
pub(super) fn two_points(seeds: [u32; 2], reversed_index: u16) -> [[f32; 4]; 2] {
    dispatch!(instruction_set::widest(), simd => two(simd, seeds, reversed_index))
}

#[inline(always)]
fn two<S: Simd>(simd: S, [a, b]: [u32; 2], reversed_index: u16) -> [[f32; 4]; 2] {
    let [p, q] = [shuffled(a, reversed_index), shuffled(b, reversed_index)];
    let bits = u32x8::from_slice(simd, &[p[0], p[1], p[2], p[3], q[0], q[1], q[2], q[3]]);
    let [x, y, z, w] = DIMENSIONS;
    let seeds = u32x8::from_slice(simd, &[a ^ x, a ^ y, a ^ z, a ^ w, b ^ x, b ^ y, b ^ z, b ^ w]);
    let numbers = reverse_bits(scramble_lanes(bits, mix_lanes(seeds))) >> 8;
    let numbers = numbers.to_float::<f32x8<S>>() * (1.0 / 16_777_216.0);
    let mut out = [0.0; 8];
    numbers.store_slice(&mut out);
    let [p0, p1, p2, p3, q0, q1, q2, q3] = out;
    [[p0, p1, p2, p3], [q0, q1, q2, q3]]
}

/// [`mix`] of lanes.
#[inline(always)]
fn mix_lanes<S: Simd>(mut x: u32x8<S>) -> u32x8<S> {
    x = (x ^ (x >> 16)) * 0x7feb_352d;
    x = (x ^ (x >> 15)) * 0x846c_a68b;
    x ^ (x >> 16)
}

/// [`scramble_reversed`] of lanes.
#[inline(always)]
fn scramble_lanes<S: Simd>(mut x: u32x8<S>, seed: u32x8<S>) -> u32x8<S> {
    x ^= x * SCRAMBLE[0];
    x = (x + seed) * ((seed >> 16) | 1);
    x ^= x * SCRAMBLE[1];
    x ^ (x * SCRAMBLE[2])
}

/// Bits in reversed order: neighbours, pairs and halves of bytes change places, then bytes.
#[inline(always)]
fn reverse_bits<S: Simd>(mut x: u32x8<S>) -> u32x8<S> {
    x = ((x >> 1) & 0x5555_5555) | ((x & 0x5555_5555) << 1);
    x = ((x >> 2) & 0x3333_3333) | ((x & 0x3333_3333) << 2);
    x = ((x >> 4) & 0x0f0f_0f0f) | ((x & 0x0f0f_0f0f) << 4);
    x = ((x >> 8) & 0x00ff_00ff) | ((x & 0x00ff_00ff) << 8);
    (x >> 16) | (x << 16)
}

/// Bit-reversed Sobol points for each value of the low and of the high byte of a 16-bit index, bits of the byte reversed, too; XOR of both is the point.
static REVERSED: [[[u32; 4]; 256]; 2] = table();

const fn table() -> [[[u32; 4]; 256]; 2] {
    // Direction numbers m₁, m₂ ... of the first four dimensions (Joe & Kuo 2008, new-joe-kuo-6): degree, coefficients, m.
    let mut directions = [[0u32; 16]; 4];
    let degree = [0usize, 1, 2, 3];
    let coefficients = [0u32, 0, 1, 1];
    let initial = [[0u32; 3], [1, 0, 0], [1, 3, 0], [1, 3, 1]];
    let mut d = 0;
    while d < 4 {
        let mut k = 0;
        while k < 16 {
            let m = if d == 0 {
                1u32 << (31 - k)
            } else if k < degree[d] {
                initial[d][k] << (31 - k)
            } else {
                let s = degree[d];
                let mut v = directions[d][k - s] ^ (directions[d][k - s] >> s);
                let mut j = 1;
                while j < s {
                    if (coefficients[d] >> (s - 1 - j)) & 1 == 1 {
                        v ^= directions[d][k - j];
                    }
                    j += 1;
                }
                v
            };
            directions[d][k] = m;
            k += 1;
        }
        d += 1;
    }
    let mut table = [[[0u32; 4]; 256]; 2];
    let mut byte = 0;
    while byte < 2 {
        let mut value: u8 = 0;
        loop {
            let mut d = 0;
            while d < 4 {
                let mut x = 0;
                let mut bit = 0;
                while bit < 8 {
                    if (value >> bit) & 1 == 1 {
                        x ^= directions[d][byte * 8 + bit];
                    }
                    bit += 1;
                }
                table[byte][value.reverse_bits() as usize][d] = x.reverse_bits();
                d += 1;
            }
            if value == 255 {
                break;
            }
            value += 1;
        }
        byte += 1;
    }
    table
}
