//! Where packets meet surfaces: conics in closed form, aspheres, Forbes polynomials and polynomials over the plane by their series.

/// Sags, roots and turns.
macro_rules! shapes {
    ($float:ident, $vector:ident, $mask:ident) => {
        /// z and z'/r of a rotational asphere or of the profile of a toroid.
        #[inline(always)]
        fn sag<S: Simd>(
            simd: S,
            c: $vector<S>,
            k1: $vector<S>,
            a: &[$float],
            r2: $vector<S>,
        ) -> ($vector<S>, $vector<S>, $mask<S>) {
            let (zero, one) = ($vector::splat(simd, 0.0), $vector::splat(simd, 1.0));
            let root2 = one - k1 * c * c * r2;
            let real = root2.simd_gt(zero);
            let root = root2.max($vector::splat(simd, 1e-12)).sqrt();
            let r = r2.sqrt();
            let (mut z, mut slope) = (zero, zero);
            let mut i = a.len();
            while i > 1 {
                i -= 1;
                slope = slope * r + z;
                z = z * r + $vector::splat(simd, a[i]);
            }
            // Now Σ aᵢ rⁱ⁻¹ and its derivative: the slope over r needs a₁ = 0 at the axis, which r's floor keeps finite.
            let over_r = slope + z / r.max($vector::splat(simd, 1e-9));
            (c * r2 / (one + root) + z * r, c / root + over_r, real)
        }

        /// The same of a Q-type asphere: [`crate::forbes::Forbes::sag`].
        #[inline(always)]
        fn forbes_sag<S: Simd>(
            simd: S,
            c: $vector<S>,
            k1: $vector<S>,
            q: &QSeries,
            r2: $vector<S>,
        ) -> ($vector<S>, $vector<S>, $mask<S>) {
            let (zero, one) = ($vector::splat(simd, 0.0), $vector::splat(simd, 1.0));
            let root2 = one - k1 * c * c * r2;
            let real = root2.simd_gt(zero);
            let root = root2.max($vector::splat(simd, 1e-12)).sqrt();
            let scale = $vector::splat(simd, q.scale);
            let x = r2 * scale;
            let (mut t, mut before) = ($vector::splat(simd, q.first), zero);
            let (mut dt, mut d_before) = (zero, zero);
            let (mut sum, mut by_x) = (zero, zero);
            for [w, a, b, g] in &q.terms {
                let (w, b, g) = ($vector::splat(simd, *w), $vector::splat(simd, *b), $vector::splat(simd, *g));
                sum = sum + w * t;
                by_x = by_x + w * dt;
                let factor = $vector::splat(simd, *a) + b * x;
                let (next, d_next) = (factor * t - g * before, b * t + factor * dt - g * d_before);
                (t, before, dt, d_before) = (next, t, d_next, dt);
            }
            let twice = scale + scale;
            let (z, over_r) = match q.kind {
                ForbesKind::Conic => (x * x * sum, twice * ((x + x) * sum + x * x * by_x)),
                ForbesKind::BestFitSphere => {
                    let bump = x * (one - x);
                    let slope = (one - x - x) * sum + bump * by_x;
                    let (k, c2) = (k1 - one, c * c);
                    let across2 = (one - k * c2 * r2).max($vector::splat(simd, 1e-12));
                    let steep = across2.sqrt() / root;
                    let steepens = c2 * (k1 / (root * root) - k / across2);
                    (bump * sum * steep, steep * (twice * slope + bump * sum * steepens))
                }
            };
            (c * r2 / (one + root) + z, c / root + over_r, real)
        }

        /// Value and slopes in x and y of a polynomial over the plane: `Polynomial::at`.
        #[inline(always)]
        fn plane_series<S: Simd>(simd: S, p: &PlaneSeries, x: $vector<S>, y: $vector<S>) -> ($vector<S>, $vector<S>, $vector<S>) {
            let (zero, one) = ($vector::splat(simd, 0.0), $vector::splat(simd, 1.0));
            let scale = $vector::splat(simd, p.scale);
            let (u, v) = (x * scale, y * scale);
            let rho = u * u + v * v;
            let (mut sum, mut by_rho) = (zero, zero);
            for a in p.radial.iter().rev() {
                let inner = sum + $vector::splat(simd, *a);
                by_rho = by_rho * rho + inner;
                sum = inner * rho;
            }
            let (mut by_u, mut by_v) = ((u + u) * by_rho, (v + v) * by_rho);
            let (mut rows, mut rows_u, mut rows_v) = (zero, zero, zero);
            for row in p.rows.iter().rev() {
                let (mut value, mut slope) = (zero, zero);
                for b in row.iter().rev() {
                    slope = slope * u + value;
                    value = value * u + $vector::splat(simd, *b);
                }
                rows_v = rows_v * v + rows;
                rows = rows * v + value;
                rows_u = rows_u * v + slope;
            }
            sum = sum + rows;
            by_u = by_u + rows_u;
            by_v = by_v + rows_v;
            let (mut power_re, mut power_im, mut before_re, mut before_im, mut m) = (one, zero, zero, zero, 0);
            for (frequency, terms) in &p.rings {
                while m < *frequency {
                    (before_re, before_im) = (power_re, power_im);
                    (power_re, power_im) = (u * before_re - v * before_im, u * before_im + v * before_re);
                    m += 1;
                }
                let (mut q, mut before, mut dq, mut d_before) = (one, zero, zero, zero);
                let (mut c, mut s, mut dc, mut ds) = (zero, zero, zero, zero);
                for [wc, ws, a, b, g] in terms {
                    let (wc, ws) = ($vector::splat(simd, *wc), $vector::splat(simd, *ws));
                    c = c + wc * q;
                    s = s + ws * q;
                    dc = dc + wc * dq;
                    ds = ds + ws * dq;
                    let (b, g) = ($vector::splat(simd, *b), $vector::splat(simd, *g));
                    let factor = $vector::splat(simd, *a) + b * rho;
                    let (next, d_next) = (factor * q - g * before, b * q + factor * dq - g * d_before);
                    (q, before, dq, d_before) = (next, q, d_next, dq);
                }
                let along = dc * power_re + ds * power_im;
                let along = along + along;
                let turn = $vector::splat(simd, m as $float);
                sum = sum + c * power_re + s * power_im;
                by_u = by_u + along * u + turn * (c * before_re + s * before_im);
                by_v = by_v + along * v + turn * (s * before_re - c * before_im);
            }
            (sum, by_u * scale, by_v * scale)
        }

        /// Root of a t² + 2 b t + q nearest the vertex, as in the plain trace.
        #[inline(always)]
        fn root<S: Simd>(simd: S, a: $vector<S>, b: $vector<S>, q: $vector<S>, sense: $vector<S>) -> ($vector<S>, $mask<S>) {
            let zero = $vector::splat(simd, 0.0);
            let root2 = b * b - a * q;
            let real = root2.simd_ge(zero);
            let root = sense * root2.max(zero).sqrt();
            let far = (b * sense).simd_gt(zero);
            let mut t = q / (root - b);
            // Only rays beyond 90° come here.
            if far.to_bitmask() != 0 {
                t = far.select((-b - root) / a, t);
            }
            (t, real)
        }

        #[inline(always)]
        fn conic<S: Simd>(
            simd: S,
            c: $vector<S>,
            k: $vector<S>,
            px: $vector<S>,
            py: $vector<S>,
            pz: $vector<S>,
            dx: $vector<S>,
            dy: $vector<S>,
            dz: $vector<S>,
            sense: $vector<S>,
        ) -> ($vector<S>, $mask<S>) {
            let one = $vector::splat(simd, 1.0);
            let a = c * (one + k * dz * dz);
            let b = c * (px * dx + py * dy + pz * dz + k * pz * dz) - dz;
            let q = c * (px * px + py * py + pz * pz + k * pz * pz) - (pz + pz);
            root(simd, a, b, q, sense)
        }

        #[inline(always)]
        fn rotate<S: Simd>(
            simd: S,
            m: &[[$float; 3]; 3],
            x: $vector<S>,
            y: $vector<S>,
            z: $vector<S>,
        ) -> ($vector<S>, $vector<S>, $vector<S>) {
            let s = [
                [$vector::splat(simd, m[0][0]), $vector::splat(simd, m[0][1]), $vector::splat(simd, m[0][2])],
                [$vector::splat(simd, m[1][0]), $vector::splat(simd, m[1][1]), $vector::splat(simd, m[1][2])],
                [$vector::splat(simd, m[2][0]), $vector::splat(simd, m[2][1]), $vector::splat(simd, m[2][2])],
            ];
            (
                s[0][0] * x + s[0][1] * y + s[0][2] * z,
                s[1][0] * x + s[1][1] * y + s[1][2] * z,
                s[2][0] * x + s[2][1] * y + s[2][2] * z,
            )
        }

        #[inline(always)]
        fn rotate_back<S: Simd>(
            simd: S,
            m: &[[$float; 3]; 3],
            x: $vector<S>,
            y: $vector<S>,
            z: $vector<S>,
        ) -> ($vector<S>, $vector<S>, $vector<S>) {
            let t = [[m[0][0], m[1][0], m[2][0]], [m[0][1], m[1][1], m[2][1]], [m[0][2], m[1][2], m[2][2]]];
            rotate(simd, &t, x, y, z)
        }
    };
}
pub(super) use shapes;
