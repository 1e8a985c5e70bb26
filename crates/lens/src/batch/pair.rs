//! Two vectors side by side: square roots and divisions of one hide the waiting of the other.

use fearless_simd::{Simd, prelude::*};

/// Two vectors side by side, with the operations that the kernel needs.
macro_rules! pair {
    ($pair:ident, $mask_pair:ident, $float:ident, $half:literal, $vector:ident, $mask:ident) => {
        #[derive(Clone, Copy)]
        pub struct $pair<S: Simd>(pub fearless_simd::$vector<S>, pub fearless_simd::$vector<S>);

        #[derive(Clone, Copy)]
        pub struct $mask_pair<S: Simd>(pub fearless_simd::$mask<S>, pub fearless_simd::$mask<S>);

        impl<S: Simd> $pair<S> {
            #[inline(always)]
            pub(super) fn splat(simd: S, v: $float) -> Self {
                let v = fearless_simd::$vector::splat(simd, v);
                $pair(v, v)
            }
            #[inline(always)]
            pub(super) fn from_slice(simd: S, v: &[$float; 2 * $half]) -> Self {
                $pair(
                    fearless_simd::$vector::from_slice(simd, &v[..$half]),
                    fearless_simd::$vector::from_slice(simd, &v[$half..]),
                )
            }
            #[inline(always)]
            pub(super) fn store_slice(self, out: &mut [$float; 2 * $half]) {
                self.0.store_slice(&mut out[..$half]);
                self.1.store_slice(&mut out[$half..]);
            }
            #[inline(always)]
            pub(super) fn to_array(self) -> [$float; 2 * $half] {
                let mut out = [0.0; 2 * $half];
                self.store_slice(&mut out);
                out
            }
            #[inline(always)]
            pub(super) fn sqrt(self) -> Self {
                $pair(self.0.sqrt(), self.1.sqrt())
            }
            #[inline(always)]
            pub(super) fn abs(self) -> Self {
                $pair(self.0.abs(), self.1.abs())
            }
            #[inline(always)]
            pub(super) fn max(self, o: Self) -> Self {
                $pair(self.0.max(o.0), self.1.max(o.1))
            }
            #[inline(always)]
            pub(super) fn simd_gt(self, o: Self) -> $mask_pair<S> {
                $mask_pair(self.0.simd_gt(o.0), self.1.simd_gt(o.1))
            }
            #[inline(always)]
            pub(super) fn simd_ge(self, o: Self) -> $mask_pair<S> {
                $mask_pair(self.0.simd_ge(o.0), self.1.simd_ge(o.1))
            }
            #[inline(always)]
            pub(super) fn simd_le(self, o: Self) -> $mask_pair<S> {
                $mask_pair(self.0.simd_le(o.0), self.1.simd_le(o.1))
            }
            #[inline(always)]
            pub(super) fn simd_lt(self, o: Self) -> $mask_pair<S> {
                $mask_pair(self.0.simd_lt(o.0), self.1.simd_lt(o.1))
            }
            #[inline(always)]
            pub(super) fn simd_eq(self, o: Self) -> $mask_pair<S> {
                $mask_pair(self.0.simd_eq(o.0), self.1.simd_eq(o.1))
            }
        }

        impl<S: Simd> $mask_pair<S> {
            #[inline(always)]
            pub(super) fn to_bitmask(self) -> u64 {
                self.0.to_bitmask() | self.1.to_bitmask() << $half
            }
            #[inline(always)]
            pub(super) fn select(self, a: $pair<S>, b: $pair<S>) -> $pair<S> {
                $pair(self.0.select(a.0, b.0), self.1.select(a.1, b.1))
            }
        }

        impl<S: Simd> std::ops::BitAnd for $mask_pair<S> {
            type Output = Self;
            #[inline(always)]
            fn bitand(self, o: Self) -> Self {
                $mask_pair(self.0 & o.0, self.1 & o.1)
            }
        }

        impl<S: Simd> std::ops::Neg for $pair<S> {
            type Output = Self;
            #[inline(always)]
            fn neg(self) -> Self {
                $pair(-self.0, -self.1)
            }
        }

        pair!(@operator $pair, Add, add, +);
        pair!(@operator $pair, Sub, sub, -);
        pair!(@operator $pair, Mul, mul, *);
        pair!(@operator $pair, Div, div, /);
    };
    (@operator $pair:ident, $trait:ident, $method:ident, $operator:tt) => {
        impl<S: Simd> std::ops::$trait for $pair<S> {
            type Output = Self;
            #[inline(always)]
            fn $method(self, o: Self) -> Self {
                $pair(self.0 $operator o.0, self.1 $operator o.1)
            }
        }
    };
}

pair!(Single, SingleMask, f32, 16, f32x16, mask32x16);
pair!(Double, DoubleMask, f64, 8, f64x8, mask64x8);
