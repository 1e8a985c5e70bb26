//! The steps of the trace for all lanes at once.

/// From surface to surface.
macro_rules! kernel {
    ($float:ident, $vector:ident, $mask:ident, $refract:ident) => {
        #[inline(always)]
        fn indices<S: Simd>(simd: S, batch: &Batch, nm: &Lanes, out: &mut Indices) {
            let [short, long] = VISIBLE_NM;
            let (low, high) = (long.powi(-2), short.powi(-2));
            let scale = $vector::splat(simd, (2.0 / (high - low)) as $float);
            let offset = $vector::splat(simd, ((high + low) / (high - low)) as $float);
            let one = $vector::splat(simd, 1.0);
            let nm = $vector::from_slice(simd, nm);
            let x = scale / (nm * nm) - offset;
            let twice = x + x;
            let rows = batch.glasses.len() + usize::from(batch.diffractive);
            out.n.resize(rows, [1.0; LANES]);
            out.inverse.resize(rows, [1.0; LANES]);
            if batch.diffractive {
                (nm * $vector::splat(simd, 1e-6)).store_slice(&mut out.n[rows - 1]);
            }
            for (fit, (n, inverse)) in batch.glasses.iter().zip(out.n.iter_mut().zip(out.inverse.iter_mut())) {
                let mut value = one;
                if let Some(fit) = fit {
                    // Clenshaw's recurrence.
                    let (mut b1, mut b2) = ($vector::splat(simd, 0.0), $vector::splat(simd, 0.0));
                    let mut k = TERMS - 1;
                    while k > 0 {
                        let b0 = twice * b1 - b2 + $vector::splat(simd, fit[k]);
                        b2 = b1;
                        b1 = b0;
                        k -= 1;
                    }
                    value = x * b1 - b2 + $vector::splat(simd, fit[0]);
                }
                value.store_slice(n);
                (one / value).store_slice(inverse);
            }
        }

        /// Follows a packet through some neighbouring surfaces; with wavelengths (nm) also what is left of its light. One function for both: each copy of it is large.
        #[inline(always)]
        fn trace<S: Simd>(
            simd: S,
            batch: &Batch,
            packet: &mut Packet,
            n: &Indices,
            nm: Option<&Lanes>,
            way: TraceDirection,
            surfaces: Range<usize>,
        ) -> u32 {
            let (zero, one) = ($vector::splat(simd, 0.0), $vector::splat(simd, 1.0));
            let two = $vector::splat(simd, 2.0);
            let (mut ox, mut oy, mut oz) = (
                $vector::from_slice(simd, &packet.x),
                $vector::from_slice(simd, &packet.y),
                $vector::from_slice(simd, &packet.z),
            );
            let (mut dx, mut dy, mut dz) = (
                $vector::from_slice(simd, &packet.dx),
                $vector::from_slice(simd, &packet.dy),
                $vector::from_slice(simd, &packet.dz),
            );
            let mut path = zero;
            let mut fraction = one;
            let mut depth = zero;
            let mut alive = one.simd_gt(zero);
            // Positions are kept relative to the vertex of the surface last met: f32 has its digits where they count.
            let mut z_origin: $float = 0.0;
            if let (TraceDirection::ToFilm, 0, Some((m, t))) = (way, surfaces.start, &batch.object_axis) {
                (ox, oy, oz) = rotate(simd, m, ox, oy, oz);
                (ox, oy, oz) =
                    (ox + $vector::splat(simd, t[0]), oy + $vector::splat(simd, t[1]), oz + $vector::splat(simd, t[2]));
                (dx, dy, dz) = rotate(simd, m, dx, dy, dz);
            }
            let count = batch.steps.len();
            for number in 0..surfaces.len() {
                let (i, before, after) = match way {
                    TraceDirection::ToFilm => (surfaces.start + number, surfaces.start + number, surfaces.start + number + 1),
                    TraceDirection::ToObject => (surfaces.end - 1 - number, surfaces.end - number, surfaces.end - 1 - number),
                };
                let step = &batch.steps[i];
                let run = match way {
                    TraceDirection::ToFilm => batch.runs[before],
                    TraceDirection::ToObject => -batch.runs[before],
                };
                if step.refracting {
                    let s = Refracting { c: step.c, run, ahead: step.z - z_origin, outer2: step.open2 };
                    let (n0, n1) = ($vector::from_slice(simd, &n.n[before]), $vector::from_slice(simd, &n.n[after]));
                    let inverse1 = $vector::from_slice(simd, &n.inverse[after]);
                    let a = Rays { position: [ox.0, oy.0, oz.0], direction: [dx.0, dy.0, dz.0], path: path.0, alive: alive.0 };
                    let b = Rays { position: [ox.1, oy.1, oz.1], direction: [dx.1, dy.1, dz.1], path: path.1, alive: alive.1 };
                    let (a, cos_a) = $refract(simd, s, [n0.0, n1.0, inverse1.0], a);
                    let (b, cos_b) = $refract(simd, s, [n0.1, n1.1, inverse1.1], b);
                    if let Some(nm) = nm {
                        let [cos0, cos1] = [0, 1].map(|k| $vector(cos_a[k], cos_b[k]));
                        fraction = fraction * passed(simd, &step.coating, n0, n1, cos0, cos1, nm, way);
                        let table = &batch.absorption[before];
                        if !table.is_empty() {
                            let t = ($vector(a.path, b.path) - path) * $vector::from_slice(simd, &n.inverse[before]);
                            depth = depth + $vector::from_slice(simd, &absorbed(table, nm)) * t.abs();
                        }
                    }
                    let join = |k: usize| $vector(a.position[k], b.position[k]);
                    (ox, oy, oz) = (join(0), join(1), join(2));
                    let join = |k: usize| $vector(a.direction[k], b.direction[k]);
                    (dx, dy, dz) = (join(0), join(1), join(2));
                    path = $vector(a.path, b.path);
                    alive = $mask(a.alive, b.alive);
                    z_origin = step.z;
                    continue;
                }
                let sense = $vector::splat(simd, run);
                if let Some(system) = batch.graded.as_ref().filter(|s| s.gradients[before].is_some()) {
                    let (mut x, mut y, mut z) = (ox.to_array(), oy.to_array(), oz.to_array());
                    let (mut u, mut v, mut w) = (dx.to_array(), dy.to_array(), dz.to_array());
                    let (mut added, mut there) = ([0.0; LANES], [0.0; LANES]);
                    let (lanes, origin) = (alive.to_bitmask(), z_origin as f64);
                    for lane in (0..LANES).filter(|lane| lanes >> lane & 1 == 1) {
                        let position = DVec3::new(x[lane] as f64, y[lane] as f64, z[lane] as f64 + origin);
                        let direction = DVec3::new(u[lane] as f64, v[lane] as f64, w[lane] as f64).normalize();
                        let index = n.n[before][lane] as f64;
                        let ray = TracedRay { position, direction };
                        let Some((end, path)) = system.cross_gradient(before, index, i, ray, run as f64) else { continue };
                        let (p, d) = (end.position, end.direction);
                        (x[lane], y[lane], z[lane]) = (p.x as $float, p.y as $float, (p.z - origin) as $float);
                        (u[lane], v[lane], w[lane]) = (d.x as $float, d.y as $float, d.z as $float);
                        (added[lane], there[lane]) = (path as $float, 1.0);
                    }
                    let lanes = |v: &Lanes| $vector::from_slice(simd, v);
                    (ox, oy, oz) = (lanes(&x), lanes(&y), lanes(&z));
                    (dx, dy, dz) = (lanes(&u), lanes(&v), lanes(&w));
                    alive = alive & lanes(&there).simd_gt(zero);
                    path = path + lanes(&added);
                    if let Some(nm) = nm.filter(|_| !batch.absorption[before].is_empty()) {
                        depth = depth
                            + lanes(&absorbed(&batch.absorption[before], nm)) * lanes(&added)
                                / $vector::from_slice(simd, &n.n[before]);
                    }
                }
                let (mut px, mut py, mut pz) = (ox, oy, oz - $vector::splat(simd, step.z - z_origin));
                z_origin = step.z;
                if let Some((m, t)) = &step.frame {
                    let (x, y) = (px - $vector::splat(simd, t[0]), py - $vector::splat(simd, t[1]));
                    let z = pz - $vector::splat(simd, t[2] - step.z);
                    (px, py, pz) = rotate(simd, m, x, y, z);
                    (dx, dy, dz) = rotate(simd, m, dx, dy, dz);
                }
                let c = $vector::splat(simd, step.c);
                let (t, nx, ny, nz, hit);
                let (hx, hy, hz);
                match &step.shape {
                    Shape::Plane => {
                        t = -pz / dz;
                        hit = t.simd_eq(t);
                        (hx, hy, hz) = (px + dx * t, py + dy * t, zero);
                        (nx, ny, nz) = (zero, zero, one);
                    }
                    Shape::Sphere => {
                        let b = c * (px * dx + py * dy + pz * dz) - dz;
                        let q = c * (px * px + py * py + pz * pz) - two * pz;
                        let (t0, real) = root(simd, c, b, q, sense);
                        t = t0;
                        (hx, hy, hz) = (px + dx * t, py + dy * t, pz + dz * t);
                        (nx, ny, nz) = (-(c * hx), -(c * hy), one - c * hz);
                        hit = real & nz.simd_gt(zero);
                    }
                    Shape::Conic => {
                        let k = $vector::splat(simd, step.k);
                        let (t0, real) = conic(simd, c, k, px, py, pz, dx, dy, dz, sense);
                        t = t0;
                        (hx, hy, hz) = (px + dx * t, py + dy * t, pz + dz * t);
                        let along = one - c * (one + k) * hz;
                        let (gx, gy) = (-(c * hx), -(c * hy));
                        let length = (gx * gx + gy * gy + along * along).sqrt();
                        (nx, ny, nz) = (gx / length, gy / length, along / length);
                        hit = real & along.simd_gt(zero);
                    }
                    Shape::Asphere(_) | Shape::Forbes(_) => {
                        let k = $vector::splat(simd, step.k);
                        let (t0, real) = conic(simd, c, k, px, py, pz, dx, dy, dz, sense);
                        let c1 = $vector::splat(simd, step.c_start);
                        let (t1, real1) = conic(simd, c1, zero, px, py, pz, dx, dy, dz, sense);
                        let plane = -pz / dz;
                        let mut s = real.select(t0, real1.select(t1, plane));
                        let k1 = one + k;
                        let mut residual = one;
                        let mut slope = zero;
                        let mut on = real;
                        let mut pass = 0;
                        while pass <= NEWTON_STEPS {
                            let (x, y, z) = (px + dx * s, py + dy * s, pz + dz * s);
                            let r2 = x * x + y * y;
                            let (height, over_r, real) = match &step.shape {
                                Shape::Asphere(a) => sag::<S>(simd, c, k1, a, r2),
                                Shape::Forbes(q) => forbes_sag::<S>(simd, c, k1, q, r2),
                                _ => (zero, zero, real),
                            };
                            residual = z - height;
                            slope = over_r;
                            on = real;
                            if pass < NEWTON_STEPS {
                                let step = residual / (dz - over_r * (x * dx + y * dy));
                                s = s - step;
                            }
                            pass += 1;
                        }
                        t = s;
                        (hx, hy, hz) = (px + dx * t, py + dy * t, pz + dz * t);
                        let (gx, gy) = (-(slope * hx), -(slope * hy));
                        let length = (gx * gx + gy * gy + one).sqrt();
                        (nx, ny, nz) = (gx / length, gy / length, one / length);
                        let scale = $vector::splat(simd, RESIDUAL) * (one + t.abs());
                        hit = on & residual.abs().simd_lt(scale);
                    }
                    Shape::Freeform(a, series) => {
                        let k = $vector::splat(simd, step.k);
                        let (t0, real) = conic(simd, c, k, px, py, pz, dx, dy, dz, sense);
                        let c1 = $vector::splat(simd, step.c_start);
                        let (t1, real1) = conic(simd, c1, zero, px, py, pz, dx, dy, dz, sense);
                        let mut s = real.select(t0, real1.select(t1, -pz / dz));
                        let k1 = one + k;
                        let mut residual = one;
                        let (mut gx, mut gy) = (zero, zero);
                        let mut on = real;
                        let mut pass = 0;
                        while pass <= NEWTON_STEPS {
                            let (x, y, z) = (px + dx * s, py + dy * s, pz + dz * s);
                            let (height, over_r, real) = sag::<S>(simd, c, k1, a, x * x + y * y);
                            let (more, by_x, by_y) = plane_series::<S>(simd, series, x, y);
                            gx = x * over_r + by_x;
                            gy = y * over_r + by_y;
                            residual = z - height - more;
                            on = real;
                            if pass < NEWTON_STEPS {
                                s = s - residual / (dz - gx * dx - gy * dy);
                            }
                            pass += 1;
                        }
                        t = s;
                        (hx, hy, hz) = (px + dx * t, py + dy * t, pz + dz * t);
                        let length = (gx * gx + gy * gy + one).sqrt();
                        (nx, ny, nz) = (-gx / length, -gy / length, one / length);
                        let scale = $vector::splat(simd, RESIDUAL) * (one + t.abs());
                        hit = on & residual.abs().simd_lt(scale);
                    }
                    Shape::Fresnel(a) => {
                        t = -pz / dz;
                        (hx, hy, hz) = (px + dx * t, py + dy * t, zero);
                        let k1 = one + $vector::splat(simd, step.k);
                        let (_, over_r, real) = sag::<S>(simd, c, k1, a, hx * hx + hy * hy);
                        let (gx, gy) = (hx * over_r, hy * over_r);
                        let length = (gx * gx + gy * gy + one).sqrt();
                        (nx, ny, nz) = (-gx / length, -gy / length, one / length);
                        hit = real & t.simd_eq(t);
                    }
                    Shape::Toroid(a) => {
                        let k1 = one + $vector::splat(simd, step.k);
                        let cx = $vector::splat(simd, step.c_x);
                        let mut s = -pz / dz;
                        let mut residual = one;
                        let (mut gx, mut gy) = (zero, zero);
                        let mut on = alive;
                        let mut pass = 0;
                        while pass <= NEWTON_STEPS {
                            let (x, y, z) = (px + dx * s, py + dy * s, pz + dz * s);
                            let (f, over_y, real) = sag::<S>(simd, c, k1, a, y * y);
                            let b = one - cx * f;
                            let root2 = b * b - cx * cx * x * x;
                            let root = root2.max($vector::splat(simd, 1e-12)).sqrt();
                            let height = f + cx * x * x / (b + root);
                            gx = cx * x / root;
                            gy = over_y * y * b / root;
                            residual = z - height;
                            on = real & root2.simd_gt(zero);
                            if pass < NEWTON_STEPS {
                                s = s - residual / (dz - gx * dx - gy * dy);
                            }
                            pass += 1;
                        }
                        t = s;
                        (hx, hy, hz) = (px + dx * t, py + dy * t, pz + dz * t);
                        let length = (gx * gx + gy * gy + one).sqrt();
                        (nx, ny, nz) = (-gx / length, -gy / length, one / length);
                        let scale = $vector::splat(simd, RESIDUAL) * (one + t.abs());
                        hit = on & residual.abs().simd_lt(scale);
                    }
                    Shape::Biconic(k_x) => {
                        let (kx1, ky1) = (one + $vector::splat(simd, *k_x), one + $vector::splat(simd, step.k));
                        let cx = $vector::splat(simd, step.c_x);
                        let mut s = -pz / dz;
                        let mut residual = one;
                        let (mut gx, mut gy) = (zero, zero);
                        let mut on = alive;
                        let mut pass = 0;
                        while pass <= NEWTON_STEPS {
                            let (x, y, z) = (px + dx * s, py + dy * s, pz + dz * s);
                            let (ax, ay) = (cx * x, c * y);
                            let root2 = one - kx1 * ax * ax - ky1 * ay * ay;
                            let root = root2.max($vector::splat(simd, 1e-12)).sqrt();
                            let inverse = one / (one + root);
                            let height = (ax * x + ay * y) * inverse;
                            let bend = height / root;
                            gx = (two * ax + bend * kx1 * cx * ax) * inverse;
                            gy = (two * ay + bend * ky1 * c * ay) * inverse;
                            residual = z - height;
                            on = root2.simd_gt(zero);
                            if pass < NEWTON_STEPS {
                                s = s - residual / (dz - gx * dx - gy * dy);
                            }
                            pass += 1;
                        }
                        t = s;
                        (hx, hy, hz) = (px + dx * t, py + dy * t, pz + dz * t);
                        let length = (gx * gx + gy * gy + one).sqrt();
                        (nx, ny, nz) = (-gx / length, -gy / length, one / length);
                        let scale = $vector::splat(simd, RESIDUAL) * (one + t.abs());
                        hit = on & residual.abs().simd_lt(scale);
                    }
                }
                let r2 = hx * hx + hy * hy;
                alive = alive & hit & r2.simd_le($vector::splat(simd, step.outer2));
                if step.inner2 > 0.0 {
                    alive = alive & r2.simd_ge($vector::splat(simd, step.inner2));
                }
                // Apertures that are no disks are asked lane by lane, by the same code as in the plain trace.
                if !step.apertures.is_empty() && alive.to_bitmask() != 0 {
                    let (x, y) = (hx.to_array(), hy.to_array());
                    let mut passes = [0.0; LANES];
                    for lane in 0..LANES {
                        let (x, y) = (x[lane] as f64, y[lane] as f64);
                        passes[lane] = if step.apertures.iter().all(|a| a.lets_through(x, y)) { 1.0 } else { 0.0 };
                    }
                    alive = alive & $vector::from_slice(simd, &passes).simd_gt(zero);
                }
                if step.stop {
                    if batch.blades.is_empty() && batch.image.is_none() {
                        alive = alive & r2.simd_le($vector::splat(simd, batch.stop_radius * batch.stop_radius));
                    }
                    for [ex, ey, distance] in &batch.blades {
                        let along = hx * $vector::splat(simd, *ex) + hy * $vector::splat(simd, *ey);
                        alive = alive & along.simd_le($vector::splat(simd, *distance));
                    }
                    if let Some(image) = &batch.image {
                        let (x, y) = (hx.to_array(), hy.to_array());
                        let mut passes = [0.0; LANES];
                        for lane in 0..LANES {
                            let (u, v) = (x[lane] / batch.stop_radius, y[lane] / batch.stop_radius);
                            passes[lane] = image.transmittance(u as f64, v as f64) as $float;
                        }
                        let passes = $vector::from_slice(simd, &passes);
                        alive = alive & passes.simd_gt(zero);
                        fraction = fraction * passes;
                    }
                }
                let mut n0 = $vector::from_slice(simd, &n.n[before]);
                let mut n1 = $vector::from_slice(simd, &n.n[after]);
                let mut inverse1 = $vector::from_slice(simd, &n.inverse[after]);
                let is_graded = |s: &&Arc<System>| s.gradients[before].is_some() || s.gradients[after].is_some();
                if let Some(system) = batch.graded.as_ref().filter(is_graded) {
                    let (x, y, z) = (hx.to_array(), hy.to_array(), hz.to_array());
                    let mut indices = [[0.0; LANES]; 2];
                    for lane in 0..LANES {
                        let place = DVec3::new(x[lane] as f64, y[lane] as f64, z[lane] as f64);
                        let point = system.surfaces[i].to_lens(place, DVec3::Z).0;
                        for (side, gap) in [before, after].into_iter().enumerate() {
                            indices[side][lane] = system.index_at(gap, n.n[gap][lane] as f64, point) as $float;
                        }
                    }
                    n0 = $vector::from_slice(simd, &indices[0]);
                    n1 = $vector::from_slice(simd, &indices[1]);
                    inverse1 = one / n1;
                }
                path = path + n0 * t;
                let facing = dx * nx + dy * ny + dz * nz;
                if let Some(focal) = step.ideal_focal_length {
                    // As `ideal::bend`, with the way of the light in `sense`.
                    let f = $vector::splat(simd, focal);
                    let (sx, sy) = (dx / dz, dy / dz);
                    let (ax, ay) = (sx - hx * sense / f, sy - hy * sense / f);
                    alive = alive & (dz * sense).simd_gt(zero);
                    let length = (ax * ax + ay * ay + one).sqrt();
                    let (bx, by, bz) = (sense * ax / length, sense * ay / length, sense / length);
                    // Slopes and direction on the object's side, as light runs there.
                    let (ux, uy, gx, gy) = match way {
                        TraceDirection::ToFilm => (sx * sense, sy * sense, dx, dy),
                        TraceDirection::ToObject => (-(ax * sense), -(ay * sense), -bx, -by),
                    };
                    let (qx, qy) = (f * ux, f * uy);
                    let whole = (qx * qx + qy * qy + f * f).sqrt();
                    let (wx, wy) = (qx - hx, qy - hy);
                    let sign = $vector::splat(simd, focal.signum());
                    path = path + sign * (whole - (wx * wx + wy * wy + f * f).sqrt()) - (gx * hx + gy * hy);
                    (dx, dy, dz) = (bx, by, bz);
                } else if let Some(phase) = &step.phase {
                    // As `Diffractive::bend`.
                    let wavelength = $vector::from_slice(simd, &n.n[count + 1]);
                    let factor = $vector::splat(simd, phase.order) * wavelength;
                    let (value, by_x, by_y) = plane_series::<S>(simd, &phase.series, hx, hy);
                    let (qx, qy, qz) = (n0 * dx + factor * by_x, n0 * dy + factor * by_y, n0 * dz);
                    let out = if step.mirror { n0 } else { n1 };
                    let across = qx * nx + qy * ny + qz * nz;
                    let (qx, qy, qz) = (qx - nx * across, qy - ny * across, qz - nz * across);
                    let rest = out * out - (qx * qx + qy * qy + qz * qz);
                    alive = alive & rest.simd_gt(zero);
                    let onwards = facing.simd_ge(zero).select(one, -one);
                    let onwards = if step.mirror { -onwards } else { onwards };
                    let along = onwards * rest.max(zero).sqrt();
                    let inverse = one / out;
                    (dx, dy, dz) = ((qx + nx * along) * inverse, (qy + ny * along) * inverse, (qz + nz * along) * inverse);
                    path = path + factor * value;
                    if let Some(nm) = nm {
                        let (cos0, cos1) = (facing.abs(), along.abs() * inverse);
                        if !step.mirror {
                            fraction = fraction * passed(simd, &step.coating, n0, n1, cos0, cos1, nm, way);
                        }
                        if let Some((diffractive, at_blaze)) = &phase.blazed {
                            let (before, after) = (n0.to_array(), n1.to_array());
                            let mut efficiency = [0.0; LANES];
                            for lane in 0..LANES {
                                let [n0, n1] = match way {
                                    TraceDirection::ToFilm => [before[lane] as f64, after[lane] as f64],
                                    TraceDirection::ToObject => [after[lane] as f64, before[lane] as f64],
                                };
                                let height = if step.mirror { 2.0 * n0 } else { n1 - n0 };
                                let nm = nm[lane] as f64;
                                efficiency[lane] = diffractive.efficiency(diffractive.order(), nm, [height, *at_blaze]) as $float;
                            }
                            fraction = fraction * $vector::from_slice(simd, &efficiency);
                        }
                    }
                } else if step.mirror {
                    let along = two * facing;
                    (dx, dy, dz) = (dx - nx * along, dy - ny * along, dz - nz * along);
                } else {
                    let mu = n0 * inverse1;
                    let cos2 = one - mu * mu * (one - facing * facing);
                    alive = alive & cos2.simd_ge(zero);
                    let cos1 = cos2.max(zero).sqrt();
                    let along = sense * cos1 - mu * facing;
                    (dx, dy, dz) = (dx * mu + nx * along, dy * mu + ny * along, dz * mu + nz * along);
                    if let Some(nm) = nm {
                        fraction = fraction * passed(simd, &step.coating, n0, n1, facing.abs(), cos1, nm, way);
                    }
                }
                if let Some(nm) = nm {
                    if step.mirror {
                        let mut reflected = [0.0; LANES];
                        let cosines = facing.to_array();
                        for lane in 0..LANES {
                            reflected[lane] = match &step.coating {
                                Coated::Table(table) => {
                                    LightTable::at(table.values(), nm[lane] as f32, cosines[lane].abs() as f32) as $float
                                }
                                _ => crate::coating::film::aluminium(nm[lane] as f64) as $float,
                            };
                        }
                        fraction = fraction * $vector::from_slice(simd, &reflected);
                    }
                    let table = &batch.absorption[before];
                    if !table.is_empty() {
                        depth = depth + $vector::from_slice(simd, &absorbed(table, nm)) * t.abs();
                    }
                }
                (ox, oy, oz) = (hx, hy, hz);
                if let Some((m, t)) = &step.frame {
                    let (x, y, z) = rotate_back(simd, m, hx, hy, hz);
                    ox = x + $vector::splat(simd, t[0]);
                    oy = y + $vector::splat(simd, t[1]);
                    oz = z + $vector::splat(simd, t[2] - step.z);
                    (dx, dy, dz) = rotate_back(simd, m, dx, dy, dz);
                }
                debug_assert_eq!(step.surface, i);
            }
            oz = oz + $vector::splat(simd, z_origin);
            if let (TraceDirection::ToObject, 0, Some((m, t))) = (way, surfaces.start, &batch.object_axis) {
                (ox, oy, oz) =
                    (ox - $vector::splat(simd, t[0]), oy - $vector::splat(simd, t[1]), oz - $vector::splat(simd, t[2]));
                (ox, oy, oz) = rotate_back(simd, m, ox, oy, oz);
                (dx, dy, dz) = rotate_back(simd, m, dx, dy, dz);
            }
            ox.store_slice(&mut packet.x);
            oy.store_slice(&mut packet.y);
            oz.store_slice(&mut packet.z);
            dx.store_slice(&mut packet.dx);
            dy.store_slice(&mut packet.dy);
            dz.store_slice(&mut packet.dz);
            path.store_slice(&mut packet.path);
            if nm.is_some() {
                fraction.store_slice(&mut packet.fraction);
                let depth = depth.to_array();
                if batch.absorption.iter().any(|a| !a.is_empty()) {
                    for lane in 0..LANES {
                        packet.fraction[lane] *= (-depth[lane]).exp();
                    }
                }
            }
            alive.to_bitmask() as u32
        }

        /// What may be left of an aspheric intersection, relative to the distance gone.
        const RESIDUAL: $float = if $float::EPSILON > 1e-10 { 2e-5 } else { 1e-11 };
    };
}
pub(super) use kernel;
