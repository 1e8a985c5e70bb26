//! A system made ready for packets.

/// Packets, indices, and surfaces made ready, with the calls that trace.
macro_rules! prepared {
    ($float:ident, $lanes:literal) => {
        /// Rays of a packet.
        pub const LANES: usize = $lanes;
        /// One number a ray.
        pub type Lanes = [$float; LANES];

        /// Rays, lens space: mm and unit directions.
        #[derive(Clone, Debug, PartialEq)]
        pub struct Packet {
            /// Position.
            pub x: Lanes,
            /// Position.
            pub y: Lanes,
            /// Position.
            pub z: Lanes,
            /// Direction.
            pub dx: Lanes,
            /// Direction.
            pub dy: Lanes,
            /// Direction.
            pub dz: Lanes,
            /// Optical path so far, mm.
            pub path: Lanes,
            /// Fraction of the light that is left; only [`Batch::trace_light`] changes it.
            pub fraction: Lanes,
        }

        impl Default for Packet {
            fn default() -> Self {
                let o = [0.0; LANES];
                Packet { x: o, y: o, z: o, dx: o, dy: o, dz: [1.0; LANES], path: o, fraction: [1.0; LANES] }
            }
        }

        impl Packet {
            /// Puts a ray (mm, unit direction) into a lane: its path is 0, none of its light is lost.
            #[inline]
            pub fn set(&mut self, i: usize, position: [$float; 3], direction: [$float; 3]) {
                [self.x[i], self.y[i], self.z[i]] = position;
                [self.dx[i], self.dy[i], self.dz[i]] = direction;
                self.path[i] = 0.0;
                self.fraction[i] = 1.0;
            }
        }

        /// Index of every gap and its inverse, lane by lane.
        #[derive(Clone, Debug, Default, PartialEq)]
        pub struct Indices {
            /// `[gap][lane]`; of a lens with diffractive surfaces the wavelengths behind them, mm.
            pub n: Vec<Lanes>,
            /// 1 / n
            inverse: Vec<Lanes>,
        }

        impl Indices {
            /// The same in all lanes: `n` as [`System::indices`], at any wavelength and not only where the fits hold.
            pub fn uniform(n: &[f64]) -> Indices {
                let all = |f: fn(f64) -> f64| n.iter().map(|v| [f(*v) as $float; LANES]).collect();
                Indices { n: all(|v| v), inverse: all(|v| 1.0 / v) }
            }
        }

        #[derive(Clone, Debug)]
        enum Shape {
            Plane,
            Sphere,
            Conic,
            Asphere(Vec<$float>),
            Forbes(QSeries),
            Toroid(Vec<$float>),
            /// Conic constant in x.
            Biconic($float),
            Freeform(Vec<$float>, PlaneSeries),
            Fresnel(Vec<$float>),
        }

        /// A polynomial over the plane: [`Polynomial`].
        #[derive(Clone, Debug)]
        struct PlaneSeries {
            /// 1 over the normalisation radius.
            scale: $float,
            /// Coefficients of ρ, ρ², ...
            radial: Vec<$float>,
            /// Rows of powers of v, each over powers of u.
            rows: Vec<Vec<$float>>,
            /// Azimuthal frequency, and weights and recurrence of each term.
            rings: Vec<(usize, Vec<[$float; 5]>)>,
        }

        impl PlaneSeries {
            fn new(p: &Polynomial) -> PlaneSeries {
                let all = |v: &Vec<f64>| v.iter().map(|v| *v as $float).collect::<Vec<_>>();
                PlaneSeries {
                    scale: (1.0 / p.norm_mm()) as $float,
                    radial: all(&p.terms().radial),
                    rows: p.rows().iter().map(all).collect(),
                    rings: p.rings().iter().map(|r| (r.m, r.terms.iter().map(|t| t.map(|v| v as $float)).collect())).collect(),
                }
            }
        }

        /// A phase on a surface.
        #[derive(Clone, Debug)]
        struct Phase {
            /// Order over 2π.
            order: $float,
            series: PlaneSeries,
            /// What tells the efficiency, where it is not 1, with the step of the relief at the blaze.
            blazed: Option<(Arc<Diffractive>, f64)>,
        }

        /// Polynomials of a Q-type asphere.
        #[derive(Clone, Debug)]
        struct QSeries {
            kind: ForbesKind,
            /// 1 over the square of the normalisation radius.
            scale: $float,
            first: $float,
            /// Weight, then α, β, γ of the recurrence, of each term.
            terms: Vec<[$float; 4]>,
        }

        impl QSeries {
            fn new(f: &Forbes) -> QSeries {
                let (weights, first, recurrence) = f.series();
                let term = |(w, [a, b, g]): (&f64, &[f64; 3])| [*w, *a, *b, *g].map(|v| v as $float);
                let scale = (1.0 / (f.norm_mm() * f.norm_mm())) as $float;
                let terms = weights.iter().zip(recurrence).map(term).collect();
                QSeries { kind: f.kind(), scale, first: first as $float, terms }
            }
        }

        #[derive(Clone, Debug)]
        struct Step {
            shape: Shape,
            c: $float,
            k: $float,
            c_x: $float,
            /// Sphere that stands in where the conic is missed.
            c_start: $float,
            z: $float,
            outer2: $float,
            inner2: $float,
            apertures: Vec<Aperture>,
            mirror: bool,
            ideal_focal_length: Option<$float>,
            phase: Option<Phase>,
            coating: Coated,
            stop: bool,
            /// Whether it is a plane or a sphere on the axis that refracts, and clips by nothing but a circle.
            refracting: bool,
            /// Square of the radius of that circle.
            open2: $float,
            /// Rows of the rotation into the local frame, and the place of the vertex.
            frame: Option<([[$float; 3]; 3], [$float; 3])>,
            /// Number of the surface.
            surface: usize,
        }

        fn rows(m: &glam::DMat3) -> [[$float; 3]; 3] {
            [0, 1, 2].map(|r| [0, 1, 2].map(|c| m.col(c)[r] as $float))
        }

        /// A system prepared for packets.
        #[derive(Clone, Debug)]
        pub struct Batch {
            steps: Vec<Step>,
            /// `runs` of the system.
            runs: Vec<$float>,
            /// Fit of the glass in each gap; `None` for air, and for what is in `unfitted`.
            glasses: Vec<Option<[$float; TERMS]>>,
            /// What the fits are of: beyond their range it is asked itself.
            media: Vec<Glass>,
            /// Gaps of glasses that no fit holds for ([`fit`]): asked themselves at every wavelength.
            unfitted: Vec<usize>,
            /// Absorption of each gap at 380, 390, ... nm, 1/mm; empty where none is known.
            absorption: Vec<Vec<$float>>,
            stop_radius: $float,
            /// Half planes of a bladed iris: normal and distance, in mm.
            blades: Vec<[$float; 3]>,
            image: Option<Iris>,
            /// Whether any surface carries a phase.
            diffractive: bool,
            /// Rows of the rotation into lens space from the object's, and its origin there, where the object has an axis of its own.
            object_axis: Option<([[$float; 3]; 3], [$float; 3])>,
            /// The system itself, where gaps have gradients: rays cross those one by one, as in the plain trace.
            graded: Option<Arc<System>>,
        }

        impl Batch {
            /// Prepares a system.
            pub fn new(system: &System) -> Batch {
                let mut coatings = coatings(system).into_iter();
                let round_iris = !matches!(system.iris.shape, Iris::Blades(_) | Iris::Image(_));
                let steps = system
                    .surfaces
                    .iter()
                    .enumerate()
                    .map(|(i, s)| {
                        let poly = |a: &Asphere| a.a.iter().map(|v| *v as $float).collect::<Vec<_>>();
                        let (shape, c, k) = match &s.profile {
                            Profile::Plane => (Shape::Plane, 0.0, 0.0),
                            Profile::Sphere(c) => (Shape::Sphere, *c, 0.0),
                            Profile::Conic { c, k } => (Shape::Conic, *c, *k),
                            Profile::Asphere(a) => (Shape::Asphere(poly(a)), a.c, a.k),
                            Profile::Forbes(f) => (Shape::Forbes(QSeries::new(f)), f.c(), f.k()),
                            Profile::Toroid { y, .. } => (Shape::Toroid(poly(y)), y.c, y.k),
                            Profile::Biconic { k_x, c_y, k_y, .. } => (Shape::Biconic(*k_x as $float), *c_y, *k_y),
                            Profile::Freeform(f) => {
                                let b = &f.base;
                                (Shape::Freeform(poly(b), PlaneSeries::new(&f.departure)), b.c, b.k)
                            }
                            Profile::Fresnel(a) => (Shape::Fresnel(poly(a)), a.c, a.k),
                        };
                        let frame = s.frame.as_ref().map(|f| (rows(&f.1.matrix3), f.0.translation.to_array().map(|v| v as $float)));
                        Step {
                            shape,
                            c: c as $float,
                            k: k as $float,
                            c_x: s.profile.curvature_x() as $float,
                            c_start: s.profile.curvature() as $float,
                            z: s.z as $float,
                            outer2: (s.semi_diameter * s.semi_diameter) as $float,
                            inner2: (s.obstruction * s.obstruction) as $float,
                            apertures: s.apertures.clone(),
                            mirror: s.mirror,
                            ideal_focal_length: s.ideal_focal_length.map(|f| f as $float),
                            phase: s.diffractive.as_ref().map(|d| Phase {
                                order: d.path_per_phase(1.0) as $float,
                                series: PlaneSeries::new(d.phase()),
                                blazed: d.blaze().map(|_| (Arc::new(d.clone()), system.blaze_step(i))),
                            }),
                            coating: coatings.next().unwrap_or(Coated::Bare),
                            stop: i == system.stop,
                            refracting: matches!(s.profile, Profile::Plane | Profile::Sphere(_))
                                && s.frame.is_none()
                                && !s.mirror
                                && s.apertures.is_empty()
                                && s.obstruction == 0.0
                                && s.ideal_focal_length.is_none()
                                && s.diffractive.is_none()
                                && system.gradients[i].is_none()
                                && system.gradients[i + 1].is_none()
                                && (i != system.stop || round_iris),
                            open2: (if i == system.stop { s.semi_diameter.min(system.iris.radius) } else { s.semi_diameter }).powi(2) as $float,
                            frame,
                            surface: i,
                        }
                    })
                    .collect();
                let blades = match &system.iris.shape {
                    Iris::Blades(b) => {
                        let edge = |e: &[f64; 3]| [e[0] as $float, e[1] as $float, (e[2] * system.iris.radius) as $float];
                        b.edges().iter().map(edge).collect()
                    }
                    _ => vec![],
                };
                let absorption = |g: &Glass| match g.knows_absorption() {
                    true => (0..=40).map(|i| g.absorption(380.0 + 10.0 * i as f64) as $float).collect(),
                    false => vec![],
                };
                let glasses: Vec<Option<[$float; TERMS]>> = system
                    .glasses
                    .iter()
                    .map(|g| fit(g).filter(|_| g.kind != GlassKind::Air).map(|c| c.map(|c| c as $float)))
                    .collect();
                let is_unfitted = |gap: &usize| glasses[*gap].is_none() && system.glasses[*gap].kind != GlassKind::Air;
                Batch {
                    steps,
                    unfitted: (0..glasses.len()).filter(is_unfitted).collect(),
                    runs: system.runs.iter().map(|r| *r as $float).collect(),
                    glasses,
                    media: system.glasses.clone(),
                    absorption: system.glasses.iter().map(absorption).collect(),
                    stop_radius: system.iris.radius as $float,
                    blades,
                    image: matches!(system.iris.shape, Iris::Image(_)).then(|| system.iris.shape.clone()),
                    diffractive: system.has_diffractive(),
                    object_axis: system.object_axis.as_ref().map(|a| (rows(&a.0.matrix3), a.0.translation.to_array().map(|v| v as $float))),
                    graded: system.has_gradients().then(|| Arc::new(system.clone())),
                }
            }

            /// Index of every gap at each lane's wavelength (nm), into `out`; NaN where a glass has none, which blocks the lane.
            pub fn indices(&self, nm: &Lanes, out: &mut Indices) {
                dispatch!(instruction_set::widest(), simd => indices(simd, self, nm, out));
                for gap in &self.unfitted {
                    for (lane, nm) in nm.iter().enumerate() {
                        let index = self.media[*gap].index(*nm as f64);
                        (out.n[*gap][lane], out.inverse[*gap][lane]) = (index as $float, (1.0 / index) as $float);
                    }
                }
                let [short, long] = VISIBLE_NM.map(|nm| nm as $float);
                if nm.iter().fold(true, |within, nm| within & (*nm >= short) & (*nm <= long)) {
                    return;
                }
                for (lane, nm) in nm.iter().enumerate().filter(|(_, nm)| !(short..=long).contains(*nm)) {
                    for (gap, glass) in self.media.iter().enumerate() {
                        let index = glass.index(*nm as f64);
                        (out.n[gap][lane], out.inverse[gap][lane]) = (index as $float, (1.0 / index) as $float);
                    }
                }
            }

            /// Follows a packet through all surfaces; the mask has a bit for each ray that came through.
            pub fn trace(&self, packet: &mut Packet, n: &Indices, way: TraceDirection) -> u32 {
                self.trace_part(packet, n, way, 0..self.steps.len())
            }

            /// [`Batch::trace`] through some neighbouring surfaces only; `n` stays that of all gaps, and paths begin anew.
            pub fn trace_part(&self, packet: &mut Packet, n: &Indices, way: TraceDirection, surfaces: Range<usize>) -> u32 {
                self.traced(packet, n, None, way, surfaces)
            }

            /// The same, and what glass, surfaces and an aperture picture leave of the light: [`Packet::fraction`].
            pub fn trace_light(&self, packet: &mut Packet, n: &Indices, nm: &Lanes, way: TraceDirection) -> u32 {
                self.traced(packet, n, Some(nm), way, 0..self.steps.len())
            }

            /// The one place where the kernel is compiled, for each kind of processor.
            fn traced(&self, packet: &mut Packet, n: &Indices, nm: Option<&Lanes>, way: TraceDirection, surfaces: Range<usize>) -> u32 {
                dispatch!(instruction_set::widest(), simd => trace(simd, self, packet, n, nm, way, surfaces))
            }
        }
    };
}
pub(super) use prepared;
