//! What surfaces and glasses take from the light of packets.

/// Fractions that pass.
macro_rules! light {
    ($float:ident, $vector:ident) => {
        /// Fraction of the light that what is on a surface lets through.
        #[inline(always)]
        fn passed<S: Simd>(
            simd: S,
            coating: &Coated,
            n0: $vector<S>,
            n1: $vector<S>,
            cos0: $vector<S>,
            cos1: $vector<S>,
            nm: &Lanes,
            way: TraceDirection,
        ) -> $vector<S> {
            match coating {
                Coated::Perfect => $vector::splat(simd, 1.0),
                Coated::Flat(through) => $vector::splat(simd, *through as $float),
                Coated::QuarterWave => quarter_wave(simd, n0, n1, cos0, cos1, $vector::from_slice(simd, nm)),
                Coated::Bare => fresnel(simd, n0, n1, cos0, cos1),
                Coated::Table(table) => {
                    let from_object = matches!(way, TraceDirection::ToFilm);
                    let cosines = if table.is_by_object_side() == from_object { cos0 } else { cos1 }.to_array();
                    let (values, mut through) = (table.values(), [0.0; LANES]);
                    for lane in 0..LANES {
                        through[lane] = LightTable::at(values, nm[lane] as f32, cosines[lane] as f32) as $float;
                    }
                    $vector::from_slice(simd, &through)
                }
            }
        }

        /// Absorption (1/mm) at the wavelengths of the lanes, of a table at 380, 390, ... nm.
        #[inline(always)]
        fn absorbed(table: &[$float], nm: &Lanes) -> Lanes {
            nm.map(|nm| {
                let at = ((nm - 380.0) * 0.1).clamp(0.0, 39.999);
                let i = at as usize;
                table[i] + (table[i + 1] - table[i]) * (at - i as $float)
            })
        }

        #[inline(always)]
        fn fresnel<S: Simd>(simd: S, n0: $vector<S>, n1: $vector<S>, c0: $vector<S>, c1: $vector<S>) -> $vector<S> {
            let s = (n0 * c0 - n1 * c1) / (n0 * c0 + n1 * c1);
            let p = (n1 * c0 - n0 * c1) / (n1 * c0 + n0 * c1);
            $vector::splat(simd, 1.0) - $vector::splat(simd, 0.5) * (s * s + p * p)
        }

        #[inline(always)]
        fn quarter_wave<S: Simd>(
            simd: S,
            n0: $vector<S>,
            n1: $vector<S>,
            c0: $vector<S>,
            c1: $vector<S>,
            nm: $vector<S>,
        ) -> $vector<S> {
            let (zero, one) = ($vector::splat(simd, 0.0), $vector::splat(simd, 1.0));
            let film = $vector::splat(simd, MGF2 as $float);
            let ratio = n0 / film;
            let cf = (one - ratio * ratio * (one - c0 * c0)).max(zero).sqrt();
            // The phase lies around π: −cos(phase − π) by its series.
            let pi = $vector::splat(simd, std::$float::consts::PI);
            let u = $vector::splat(simd, (std::f64::consts::PI * FILM_NM) as $float) / nm * cf - pi;
            let v = u * u;
            let series = |c: f64| $vector::splat(simd, c as $float);
            let cosine = series(1.0)
                + v * (series(-0.5)
                    + v * (series(1.0 / 24.0)
                        + v * (series(-1.0 / 720.0) + v * (series(1.0 / 40320.0) - v * series(1.0 / 3628800.0)))));
            let cosine = -cosine;
            let rs0 = (n0 * c0 - film * cf) / (n0 * c0 + film * cf);
            let rs1 = (film * cf - n1 * c1) / (film * cf + n1 * c1);
            let rp0 = (film * c0 - n0 * cf) / (film * c0 + n0 * cf);
            let rp1 = (n1 * cf - film * c1) / (n1 * cf + film * c1);
            let xs = (rs0 * rs1 + rs0 * rs1) * cosine;
            let xp = (rp0 * rp1 + rp0 * rp1) * cosine;
            let s = (rs0 * rs0 + rs1 * rs1 + xs) / (one + rs0 * rs0 * rs1 * rs1 + xs);
            let p = (rp0 * rp0 + rp1 * rp1 + xp) / (one + rp0 * rp0 * rp1 * rp1 + xp);
            one - $vector::splat(simd, 0.5) * (s + p)
        }
    };
}
pub(super) use light;
