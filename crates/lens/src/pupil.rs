//! The exit pupil as a film point sees it, cut by vignetting: tables of its shapes, from which only directions that (nearly all) reach the scene are drawn.
//!
//! A direction from film point x is s, its slope towards the lens; the table lives in q = s + κ x, with 1/κ the distance of the
//! exit pupil: in q the pupil of a small stop stands still over the whole field, and a telecentric lens (κ = 0) is nothing
//! special. An element dq carries dE = L cos⁴θ dq, so a direction drawn evenly from a region of area A weighs A cos⁴θ exactly.
//!
//! Shapes are found by tracing at 400, 550 and 700 nm, as polygons around what passes. For a convex set the arc between two
//! boundary points lies inside the triangle that their neighbours' chords make with theirs; adding these corners makes a polygon
//! that holds the set. A bin of the table holds the hull of the polygons at its ends, grown by 0.2 %; what is drawn in vain is a few per cent. Light is lost where a pupil is so far from
//! convex, between the three wavelengths or between two bins, that this does not hold it, and where it is smaller than 1/128 of the rim.

mod middles;

use self::middles::{Edge, Middles, centroid};
use crate::batch::single::{Batch, Indices, LANES, Packet};
use crate::fan::{Fan, convex_hull};
use crate::ray::TraceDirection;
use glam::{DVec2, DVec3};

/// Wavelengths at which shapes are looked for, nm.
const COLORS_NM: [f32; 3] = [400.0, 550.0, 700.0];
/// Directions in which an edge is looked for.
const ANGLES: usize = 64;
/// Rays a side of the grid that looks for light at all.
const GRID: usize = 32;
/// Most points a side of a grid over all that the last surface can let through.
const FINEST_GRID: usize = 16 * GRID;
/// Bins over the film radius for a round iris in a round lens.
const RADIAL_BINS: usize = 96;
/// Bins over the film radius, and over the period of the iris, for another iris in a round lens.
const POLAR_BINS: [usize; 2] = [44, 8];
/// Cells over the film for a lens that is not round.
const CELLS: [usize; 2] = [20, 14];
/// The same numbers where [`PupilDetail::Draft`] is asked for.
const DRAFT_RADIAL_BINS: usize = 24;
const DRAFT_POLAR_BINS: [usize; 2] = [14, 4];
const DRAFT_CELLS: [usize; 2] = [10, 8];
/// Growth that covers shapes which are not quite convex and single precision.
const MARGIN: f64 = 1.002;

/// At how many places of the film the shapes of the pupil are found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum PupilDetail {
    /// As many as it takes that few rays are drawn in vain.
    #[default]
    Full,
    /// About a seventh of them, for a lens that is set many times a second: more rays are drawn in vain where rims cut the pupil, and the shapes between
    /// two places that are farther apart are their hull less exactly (the pupil turns by 1/32 of the iris' period between a place and the middle).
    Draft,
}

/// Shape of the pupil for a part of the film.
#[derive(Clone, Debug)]
pub struct Region {
    /// Polygon in q. For a round iris in a round lens in the frame whose x axis goes through the film point; for another iris in
    /// the film's frame, turned by whole periods.
    pub fan: Fan,
}

#[derive(Clone, Debug)]
enum Layout {
    /// By radius and by angle within a period (0: round).
    Polar { radius: f64, bins: usize, period: f64, angles: usize, turns: Vec<DVec2> },
    /// By place; `mirrored`: by place in one quarter, for lenses that are the same left and right, above and below.
    Cells { half: DVec2, counts: [usize; 2], mirrored: bool },
}

/// How a region's frame lies in the film's: turned, then mirrored.
#[derive(Clone, Copy, Debug)]
pub struct Turn {
    rotation: DVec2,
    mirror: DVec2,
}

impl Turn {
    const NONE: Turn = Turn { rotation: DVec2::X, mirror: DVec2::ONE };

    fn by(rotation: DVec2) -> Turn {
        Turn { rotation, mirror: DVec2::ONE }
    }
}

/// All regions of a lens as it stands.
#[derive(Clone, Debug)]
pub struct PupilTable {
    layout: Layout,
    regions: Vec<Region>,
    /// In q; of a round lens by radius and angle, with the x axis through the film point, else by place.
    middles: Middles,
    /// 1 / distance from the film to the exit pupil, 1/mm.
    pub curvature: f64,
}

/// What finding shapes needs to know about the lens.
pub struct Geometry<'a> {
    /// The lens.
    pub batch: &'a Batch,
    /// Film plane, mm from the first vertex.
    pub film_z: f64,
    /// Way of the light at the film ([`crate::System::film_run`]).
    pub film_run: f64,
    /// 1 / distance from the film to the exit pupil.
    pub curvature: f64,
    /// Place of the middle of the exit pupil in q: 0 but for lenses that are turned against the film.
    pub middle: DVec2,
    /// Radius of the exit pupil over its distance: 1/(2N) on the axis.
    pub slope: f64,
    /// Distances from the film between which the last surface lies within its rim, and the rim's radius, mm.
    pub rim: ([f64; 2], f64),
    /// Half size of the film, mm.
    pub film_half: DVec2,
    /// Lens without iris looks the same from all sides.
    pub rotational: bool,
    /// Lens is the same left and right, above and below.
    pub mirrored: bool,
    /// Period of the iris, rad; 0 round.
    pub iris_period: f64,
}

/// Distance from the axis (mm) beyond which no light of any colour falls on the film in a direction (unit vector on the film), at most
/// `most`; to `most` / 512. Light is found that fills at least 1/128 of the rim of the last surface, each way.
pub fn image_circle_radius(g: &Geometry, towards: DVec2, most: f64) -> f64 {
    Search::new(g).image_circle_radius(towards, most)
}

impl PupilTable {
    /// Looks for the shapes.
    pub fn new(g: &Geometry, detail: PupilDetail) -> PupilTable {
        let (radial, polar, cells) = match detail {
            PupilDetail::Full => (RADIAL_BINS, POLAR_BINS, CELLS),
            PupilDetail::Draft => (DRAFT_RADIAL_BINS, DRAFT_POLAR_BINS, DRAFT_CELLS),
        };
        let mut search = Search::new(g);
        let diagonal = g.film_half.length();
        let (layout, regions, middles) = if g.rotational {
            let round = g.iris_period == 0.0;
            let (bins, angles) = if round { (radial, 1) } else { (polar[0], polar[1]) };
            let corners = if round { 1 } else { angles + 1 };
            // Where the picture of the lens ends, if it does so on the film: bins are not spent on the dark beyond.
            let radius = search.image_circle_radius(DVec2::X, diagonal);
            let mut outlines: Vec<Vec<Vec<DVec2>>> = vec![vec![]; bins + 1];
            for a in 0..corners {
                let angle = g.iris_period * a as f64 / angles as f64;
                let mut before = None;
                for r in 0..=bins {
                    let film = DVec2::from_angle(angle) * (radius * fraction(r as f64 / bins as f64));
                    let outline = search.outline(film, before.as_ref());
                    outlines[r].push(outline.clone());
                    before = Some(outline);
                }
            }
            // Seen along the film point's radius they hardly change with the angle.
            let radial = |r: usize, a: usize| {
                let back = DVec2::from_angle(-g.iris_period * a as f64 / angles as f64);
                centroid(&outlines[r][a]).map(|c| if r == 0 { DVec2::ZERO } else { back.rotate(c) })
            };
            let middles = (0..corners).flat_map(|a| (0..=bins).map(move |r| (r, a))).map(|(r, a)| radial(r, a)).collect();
            let middles = Middles::new(middles, [bins + 1, corners], [Edge::Mirrored([-1, -1]), Edge::Periodic]);
            let mut regions = Vec::with_capacity(bins * angles);
            for r in 0..bins {
                for a in 0..angles {
                    let ends = if round { vec![0] } else { vec![a, a + 1] };
                    let points = ends.iter().flat_map(|e| outlines[r][*e].iter().chain(&outlines[r + 1][*e])).copied().collect();
                    regions.push(region(points));
                }
            }
            regions.push(Region { fan: Fan::new(DVec2::ZERO, vec![]) });
            let periods = if round { 0 } else { (std::f64::consts::TAU / g.iris_period).round() as usize };
            let turns = (0..periods).map(|k| DVec2::from_angle(g.iris_period * k as f64)).collect();
            (Layout::Polar { radius, bins, period: g.iris_period, angles, turns }, regions, middles)
        } else {
            let mirrored = g.mirrored && g.iris_period == 0.0;
            let [nx, ny] = if mirrored { cells.map(|n| n / 2) } else { cells };
            let film = |i: f64, j: f64| {
                let at = DVec2::new(i / nx as f64, j / ny as f64);
                (if mirrored { at } else { 2.0 * at - 1.0 }) * g.film_half
            };
            let mut outlines: Vec<Vec<DVec2>> = vec![];
            for j in 0..=ny {
                for i in 0..=nx {
                    let before = if i > 0 { outlines.last().cloned() } else { None };
                    outlines.push(search.outline(film(i as f64, j as f64), before.as_ref()));
                }
            }
            let edges = if mirrored { [Edge::Mirrored([-1, 1]), Edge::Mirrored([1, -1])] } else { [Edge::Open; 2] };
            let middles = Middles::new(outlines.iter().map(|o| centroid(o)).collect(), [nx + 1, ny + 1], edges);
            let mut regions = Vec::with_capacity(nx * ny);
            for j in 0..ny {
                for i in 0..nx {
                    let at = |i: usize, j: usize| &outlines[j * (nx + 1) + i];
                    let all = [at(i, j), at(i + 1, j), at(i, j + 1), at(i + 1, j + 1)];
                    let points = all.into_iter().flatten().copied().collect();
                    regions.push(region(points));
                }
            }
            (Layout::Cells { half: g.film_half, counts: [nx, ny], mirrored }, regions, middles)
        };
        PupilTable { layout, regions, middles, curvature: g.curvature }
    }

    /// The same pupil from a film at another distance (mm) of it: as large, seen under other angles.
    pub fn seen_from(&self, before: f64, now: f64) -> PupilTable {
        // What rims do to the pupil depends a little on the angle: room for it.
        const ROOM: f64 = 1.01;
        let scale = before / now;
        let layout = match &self.layout {
            Layout::Polar { radius, bins, period, angles, turns } => {
                Layout::Polar { radius: radius / scale, bins: *bins, period: *period, angles: *angles, turns: turns.clone() }
            }
            Layout::Cells { half, counts, mirrored } => {
                Layout::Cells { half: *half / scale, counts: *counts, mirrored: *mirrored }
            }
        };
        let region = |r: &Region| {
            let center = r.fan.center() * scale;
            let outline = r.fan.outline().iter().map(|p| center + (*p * scale - center) * ROOM).collect();
            Region { fan: Fan::new(center, outline) }
        };
        let regions = self.regions.iter().map(region).collect();
        PupilTable { layout, regions, middles: self.middles.scaled(scale), curvature: self.curvature * scale }
    }

    /// Farthest that any region reaches from the axis. In q, a slope.
    pub fn reach(&self) -> f64 {
        let outlines = self.regions.iter().flat_map(|r| r.fan.outline());
        outlines.map(|p| p.length()).fold(0.0, f64::max)
    }

    /// Region of a film point and how its frame lies in the film's.
    #[inline]
    pub fn region(&self, film: DVec2) -> (&Region, Turn) {
        match &self.layout {
            Layout::Polar { radius, bins, period, angles, turns } => {
                let r = film.length();
                if r > *radius {
                    // The last region is the empty one.
                    return (&self.regions[bins * angles], Turn::NONE);
                }
                let bin = (((1.0 - (1.0 - r / radius).sqrt()) * *bins as f64) as usize).min(bins - 1);
                if turns.is_empty() {
                    return (&self.regions[bin], Turn::by(if r > 0.0 { film / r } else { DVec2::X }));
                }
                let phase = film.y.atan2(film.x).rem_euclid(std::f64::consts::TAU) / period;
                let turn = (phase as usize).min(turns.len() - 1);
                let sector = ((phase - turn as f64) * *angles as f64) as usize;
                (&self.regions[bin * angles + sector.min(angles - 1)], Turn::by(turns[turn]))
            }
            Layout::Cells { half, counts, mirrored } => {
                let at = if *mirrored { film.abs() / *half } else { film / *half * 0.5 + 0.5 };
                let at = at.clamp(DVec2::ZERO, DVec2::splat(0.999_999_999));
                let (i, j) = ((at.x * counts[0] as f64) as usize, (at.y * counts[1] as f64) as usize);
                let turn = match mirrored {
                    true => Turn { rotation: DVec2::X, mirror: film.signum() },
                    false => Turn::NONE,
                };
                (&self.regions[j * counts[0] + i], turn)
            }
        }
    }

    /// Corners of the shape of the pupil that a film point (mm) sees, in q in the film's frame; none where no light arrives.
    pub fn outline(&self, film: DVec2) -> impl Iterator<Item = DVec2> {
        let (region, turn) = self.region(film);
        region.fan.outline().iter().map(move |q| turn.rotation.rotate(*q) * turn.mirror)
    }

    /// Slope from a film point towards the middle of what passes: the centroid of the area of its shape in q, without steps over the film.
    pub fn centroid_slope(&self, film: DVec2) -> DVec2 {
        let (region, turn) = self.region(film);
        let own = || self.slope(film, region.fan.center(), turn);
        if region.fan.area() <= 0.0 {
            return own();
        }
        match self.middle(film) {
            Some(q) => q - film * self.curvature,
            None => own(),
        }
    }

    /// The middle of what passes in q, in the film's frame.
    fn middle(&self, film: DVec2) -> Option<DVec2> {
        match &self.layout {
            Layout::Polar { radius, bins, period, angles, .. } => {
                let r = film.length();
                if r <= 0.0 {
                    return self.middles.at(DVec2::ZERO);
                }
                let line = match *period > 0.0 {
                    true => (film.y.atan2(film.x).rem_euclid(*period) / period) * *angles as f64,
                    false => 0.0,
                };
                let place = (1.0 - (1.0 - r / radius).max(0.0).sqrt()) * *bins as f64;
                Some((film / r).rotate(self.middles.at(DVec2::new(place, line))?))
            }
            Layout::Cells { half, counts, mirrored } => {
                let counts = DVec2::new(counts[0] as f64, counts[1] as f64);
                let (at, sign) = match mirrored {
                    true => (film.abs() / *half, film.signum()),
                    false => (film / *half * 0.5 + 0.5, DVec2::ONE),
                };
                Some(self.middles.at(at * counts)? * sign)
            }
        }
    }

    /// Slope from a film point for a point of its region.
    #[inline]
    pub fn slope(&self, film: DVec2, q: DVec2, turn: Turn) -> DVec2 {
        turn.rotation.rotate(q) * turn.mirror - film * self.curvature
    }
}

/// Radius at a fraction of the bins: they are narrow where rims cut the pupil away, at the edge.
fn fraction(t: f64) -> f64 {
    1.0 - (1.0 - t) * (1.0 - t)
}

fn lane_indices(batch: &Batch, nm: f32) -> Indices {
    let mut n = Indices::default();
    batch.indices(&[nm; LANES], &mut n);
    n
}

struct Search<'a> {
    g: &'a Geometry<'a>,
    n: [Indices; 3],
    packet: Packet,
}

impl<'a> Search<'a> {
    fn new(g: &'a Geometry<'a>) -> Self {
        Search { g, n: COLORS_NM.map(|nm| lane_indices(g.batch, nm)), packet: Packet::default() }
    }

    /// Which of some points in q let light of any colour pass from a film point.
    fn passes(&mut self, film: DVec2, q: &[DVec2; LANES], colors: &[usize]) -> u32 {
        let mut mask = 0;
        for &color in colors {
            for (i, q) in q.iter().enumerate() {
                let s = *q - film * self.g.curvature;
                let d = s.extend(-self.g.film_run).normalize().as_vec3();
                self.packet.set(i, [film.x as f32, film.y as f32, self.g.film_z as f32], d.to_array());
            }
            mask |= self.g.batch.trace(&mut self.packet, &self.n[color], TraceDirection::ToObject);
        }
        mask
    }

    /// Disk in q that holds every ray through the rim of the last surface: middle and radius.
    fn bound(&self, film: DVec2) -> (DVec2, f64) {
        let ([near, far], radius) = self.g.rim;
        let at = |distance: f64| film * (self.g.curvature - 1.0 / distance);
        (0.5 * (at(near) + at(far)), 0.5 * (at(near) - at(far)).length() + radius / near * 1.001)
    }

    /// Points of a grid over a square that pass.
    fn grid(&mut self, film: DVec2, center: DVec2, half: f64, side: usize, colors: &[usize]) -> Vec<DVec2> {
        let mut found = vec![];
        let points: Vec<DVec2> = (0..side * side)
            .map(|i| {
                let cell = DVec2::new((i % side) as f64 + 0.5, (i / side) as f64 + 0.5);
                center + (cell * (2.0 / side as f64) - 1.0) * half
            })
            .collect();
        for chunk in points.chunks(LANES) {
            let q: [DVec2; LANES] = std::array::from_fn(|i| chunk[i.min(chunk.len() - 1)]);
            let mask = self.passes(film, &q, colors);
            found.extend((0..chunk.len()).filter(|i| mask >> i & 1 == 1).map(|i| q[i]));
        }
        found
    }

    /// Distance from the axis in a direction (unit vector on the film) beyond which no light falls on the film, at most `most`, mm.
    fn image_circle_radius(&mut self, towards: DVec2, most: f64) -> f64 {
        if !self.outline(towards * most, None).is_empty() {
            return most;
        }
        let (mut lit, mut dark) = (0.0, most);
        for _ in 0..9 {
            let middle = 0.5 * (lit + dark);
            if self.outline(towards * middle, None).is_empty() { dark = middle } else { lit = middle }
        }
        dark
    }

    /// Polygon around everything that passes; empty where nothing does.
    fn outline(&mut self, film: DVec2, before: Option<&Vec<DVec2>>) -> Vec<DVec2> {
        let (bound_center, bound_radius) = self.bound(film);
        // The neighbour's place first, then the paraxial pupil's, then everywhere.
        let mut tries = vec![];
        if let Some(outline) = before.filter(|o| o.len() > 2) {
            let (low, high) = outline.iter().fold((DVec2::MAX, DVec2::MIN), |(l, h), p| (l.min(*p), h.max(*p)));
            tries.push((0.5 * (low + high), 0.75 * (high - low).max_element(), GRID / 2));
        } else {
            tries.push((self.g.middle, 1.5 * self.g.slope, GRID / 2));
        }
        tries.push((bound_center, bound_radius, GRID));
        tries.push((bound_center, bound_radius, 4 * GRID));
        // Close to a large last surface a small pupil fills so little of it that it slips through: the last grid finds a pupil a third as large as that on the axis.
        let finest = (6.0 * bound_radius / self.g.slope).min(FINEST_GRID as f64) as usize;
        if finest > 4 * GRID {
            tries.push((bound_center, bound_radius, finest));
        }
        let mut found = vec![];
        for (center, half, side) in tries {
            let colors: &[usize] = if side > 4 * GRID { &[1] } else { &[0, 1, 2] };
            found = self.grid(film, center, half, side, colors);
            if found.len() >= 3 {
                break;
            }
        }
        if found.is_empty() {
            return vec![];
        }
        let center = found.iter().sum::<DVec2>() / found.len() as f64;
        // How far out there can be light: to the bound in every direction.
        let mut edge = [0.0; ANGLES];
        for (i, edge) in edge.iter_mut().enumerate() {
            let direction = DVec2::from_angle(std::f64::consts::TAU * i as f64 / ANGLES as f64);
            let from = center - bound_center;
            let along = from.dot(direction);
            let reach2 = along * along - from.length_squared() + bound_radius * bound_radius;
            let mut high = (-along + reach2.max(0.0).sqrt()).max(1e-9);
            // The last passing point outwards, 32 steps at a time: roughly for green, then finely for all colours.
            let (mut low, mut step) = (0.0f64, 0.0);
            for (stage, colors) in [&[1][..], &[0, 1, 2], &[0, 1, 2]].into_iter().enumerate() {
                if stage == 1 {
                    (low, high) = ((low - step).max(0.0), high + 2.0 * step);
                }
                step = (high - low) / LANES as f64;
                let q: [DVec2; LANES] = std::array::from_fn(|k| center + direction * (low + step * (k as f64 + 1.0)));
                let mask = self.passes(film, &q, colors);
                let last = 32 - mask.leading_zeros();
                (low, high) = (low + step * last as f64, (low + step * (last as f64 + 1.0)).min(high));
            }
            *edge = high;
        }
        let point = |i: usize| {
            let i = i % ANGLES;
            center + DVec2::from_angle(std::f64::consts::TAU * i as f64 / ANGLES as f64) * edge[i]
        };
        let mut outer = Vec::with_capacity(2 * ANGLES);
        for i in 0..ANGLES {
            let (a, b, c, d) = (point(i + ANGLES - 1), point(i), point(i + 1), point(i + 2));
            outer.push(b);
            // Where the chords before and after this one meet.
            let (u, v) = (b - a, c - d);
            let cross = u.perp_dot(v);
            let t = (c - b).perp_dot(v) / cross;
            let corner = b + u * t;
            // Nearly parallel chords say nothing; corners of a real shape are not farther than the chord is long.
            if t > 0.0 && t.is_finite() && (corner - b).length() < 2.0 * (c - b).length() {
                outer.push(corner);
            }
        }
        let hull = convex_hull(outer);
        hull.into_iter().map(|p| center + (p - center) * MARGIN).collect()
    }
}

/// The region around points.
fn region(points: Vec<DVec2>) -> Region {
    let hull = convex_hull(points);
    let center = if hull.is_empty() { DVec2::ZERO } else { hull.iter().sum::<DVec2>() / hull.len() as f64 };
    Region { fan: Fan::new(center, hull) }
}

/// Puts a ray from the film into a lane: for [`Batch::trace_light`] towards the object.
#[inline]
pub(crate) fn start(packet: &mut Packet, lane: usize, film: DVec2, film_z: f64, d: DVec3) {
    packet.set(lane, [film.x as f32, film.y as f32, film_z as f32], [d.x as f32, d.y as f32, d.z as f32]);
}
