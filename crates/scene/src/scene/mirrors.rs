//! Flat mirrors, in which rough surfaces see images of lamps.

use super::description::{Description, Object, Shape};
use crate::motion::Motion;
use crate::shape::Surface;
use glam::{Vec2, Vec3};

/// Most mirrors of a scene, the largest; most faces of an object among which they are looked for, and most triangles.
const MOST: usize = 16;
const MOST_FACES: usize = 32;
const MOST_TRIANGLES: usize = 4096;

/// Least fraction of the area of its object that a mirror has: not the bevels of its edges.
const LEAST_FRACTION: f32 = 0.1;

/// Cosine between normals, and distance over its size, within which a place belongs to a mirror.
const PARALLEL: f32 = 0.99999;
const WITHIN: f32 = 1e-4;

/// A mirror is asked always from within so many of its own sizes, the less often the farther.
const NEAR: f32 = 4.0;

/// A flat mirror of a scene that stands still.
#[derive(Clone, Debug)]
pub(crate) struct Mirror {
    object: u32,
    /// A place in its plane, m, and the unit normal.
    origin: Vec3,
    normal: Vec3,
    /// Unit vectors along the plane, and between what it lies along them, m from the origin.
    axes: [Vec3; 2],
    least: Vec2,
    most: Vec2,
    /// The place in the middle between, m.
    middle: Vec3,
    area: f32,
}

impl Mirror {
    /// The image of a place.
    #[inline]
    pub fn image(&self, point: Vec3) -> Vec3 {
        point - self.normal * (2.0 * self.normal.dot(point - self.origin))
    }

    /// The image of a direction.
    #[inline]
    pub fn turned(&self, direction: Vec3) -> Vec3 {
        direction - self.normal * (2.0 * self.normal.dot(direction))
    }

    /// Distance at which a line from a place in a unit direction meets it, m; `None` where it misses it.
    #[inline]
    pub fn met(&self, from: Vec3, direction: Vec3) -> Option<f32> {
        let distance = self.normal.dot(self.origin - from) / self.normal.dot(direction);
        let at = from + direction * distance - self.origin;
        let at = Vec2::new(self.axes[0].dot(at), self.axes[1].dot(at));
        let margin = WITHIN * (self.most - self.least).max_element();
        (distance > 0.0 && at.cmpge(self.least - margin).all() && at.cmple(self.most + margin).all()).then_some(distance)
    }

    /// Whether some of it is above a plane.
    #[inline]
    pub fn rises_above(&self, point: Vec3, normal: Vec3) -> bool {
        let reach = |axis: usize| {
            let along = normal.dot(self.axes[axis]);
            (along * self.least[axis]).max(along * self.most[axis])
        };
        normal.dot(self.origin - point) + reach(0) + reach(1) > 0.0
    }

    fn is_at(&self, surface: &Surface) -> bool {
        let size = (self.most - self.least).max_element();
        surface.object == self.object
            && surface.ng.dot(self.normal).abs() > PARALLEL
            && self.normal.dot(surface.point - self.origin).abs() < WITHIN * size
    }

    fn spread(&mut self, corners: [Vec3; 3]) {
        for corner in corners {
            let at = corner - self.origin;
            let at = Vec2::new(self.axes[0].dot(at), self.axes[1].dot(at));
            (self.least, self.most) = (self.least.min(at), self.most.max(at));
        }
        let middle = 0.5 * (self.least + self.most);
        self.middle = self.origin + self.axes[0] * middle.x + self.axes[1] * middle.y;
        self.area += area(corners);
    }
}

/// The mirrors of a scene.
#[derive(Debug, Default)]
pub(crate) struct Mirrors {
    all: Vec<Mirror>,
    weighing: Weighing,
}

/// What the weights of all mirrors are computed from, side by side; none, past the last of them, has an area of 0.
#[derive(Debug, Default)]
struct Weighing {
    /// x, y and z of their middles, m.
    middles: [[f32; MOST]; 3],
    areas: [f32; MOST],
}

impl Weighing {
    fn of(all: &[Mirror]) -> Weighing {
        let mut weighing = Weighing::default();
        for (i, mirror) in all.iter().enumerate() {
            (0..3).for_each(|axis| weighing.middles[axis][i] = mirror.middle[axis]);
            weighing.areas[i] = mirror.area;
        }
        weighing
    }

    /// How much each counts from a place before others.
    #[inline]
    fn from(&self, place: Vec3) -> [f32; MOST] {
        let mut weights = [0.0; MOST];
        let [x, y, z] = &self.middles;
        for i in 0..MOST {
            let (dx, dy, dz) = (x[i] - place.x, y[i] - place.y, z[i] - place.z);
            let squared = dx * dx + dy * dy + dz * dz;
            weights[i] = (NEAR * NEAR * self.areas[i] / squared).min(1.0);
        }
        weights
    }
}

impl Mirrors {
    /// Those of a scene that stand still.
    pub fn of(description: &Description) -> Mirrors {
        let is_mirror = |object: &Object| description.materials[object.material as usize].is_mirror();
        let mut all: Vec<Mirror> = Vec::new();
        for (number, object) in description.objects.iter().enumerate() {
            if object.motion == Motion::Still && is_mirror(object) {
                all.extend(faces(number as u32, description, object));
            }
        }
        all.sort_by(|a, b| b.area.total_cmp(&a.area));
        all.truncate(MOST);
        Mirrors { weighing: Weighing::of(&all), all }
    }

    #[inline]
    pub fn is_empty(&self) -> bool {
        self.all.is_empty()
    }

    /// The mirror at a place of a surface.
    #[inline]
    pub fn at(&self, surface: &Surface) -> Option<&Mirror> {
        self.all.iter().find(|mirror| mirror.is_at(surface))
    }

    /// One of them by a number from 0 to 1, for a place, and its probability; now and then none where all are far.
    pub fn choose(&self, from: Vec3, mut u: f32) -> Option<(&Mirror, f32)> {
        let probabilities = self.probabilities(from);
        for (mirror, probability) in self.all.iter().zip(probabilities) {
            if u < probability {
                return Some((mirror, probability));
            }
            u -= probability;
        }
        None
    }

    /// Probability with which [`Mirrors::choose`] finds a mirror.
    pub fn probability(&self, from: Vec3, mirror: &Mirror) -> f32 {
        let number = self.all.iter().position(|m| std::ptr::eq(m, mirror));
        number.map_or(0.0, |number| self.probabilities(from)[number])
    }

    /// Of each; what is missing to 1 is that of none.
    fn probabilities(&self, from: Vec3) -> [f32; MOST] {
        let weights = self.weighing.from(from);
        let all = weights[..self.all.len()].iter().sum::<f32>().max(1.0);
        weights.map(|weight| weight / all)
    }
}

fn area([a, b, c]: [Vec3; 3]) -> f32 {
    0.5 * (b - a).cross(c - a).length()
}

/// The larger flat faces of an object.
fn faces(number: u32, description: &Description, object: &Object) -> Vec<Mirror> {
    let triangles: Vec<[Vec3; 3]> = match object.shape {
        Shape::Quad(quad) => {
            let [a, b, c, d] = [Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y].map(|p| quad.point(p));
            vec![[a, b, c], [a, c, d]]
        }
        Shape::Mesh { mesh, world_from_mesh } => {
            let mesh = &description.meshes[mesh as usize];
            if mesh.triangles.len() > MOST_TRIANGLES {
                return Vec::new();
            }
            let placed = |triangle| mesh.corners(triangle).map(|corner| world_from_mesh.transform_point3(corner));
            (0..mesh.triangles.len()).map(placed).collect()
        }
        _ => return Vec::new(),
    };
    let size = triangles.iter().flatten().map(|corner| corner.distance(triangles[0][0])).fold(0.0, f32::max);
    let mut faces: Vec<Mirror> = Vec::new();
    for corners in &triangles {
        let [a, b, c] = *corners;
        let Some(normal) = (b - a).cross(c - a).try_normalize() else { continue };
        let is_in = |face: &Mirror| {
            face.normal.dot(normal).abs() > PARALLEL
                && corners.iter().all(|corner| face.normal.dot(*corner - face.origin).abs() < WITHIN * size)
        };
        let at = match faces.iter().position(is_in) {
            Some(at) => at,
            // Bent: no mirror of which there would be one image.
            None if faces.len() == MOST_FACES => return Vec::new(),
            None => {
                let along = (b - a).normalize();
                let axes = [along, normal.cross(along)];
                let (least, most) = (Vec2::ZERO, Vec2::ZERO);
                faces.push(Mirror { object: number, origin: a, normal, axes, least, most, middle: a, area: 0.0 });
                faces.len() - 1
            }
        };
        faces[at].spread(*corners);
    }
    let all: f32 = triangles.iter().map(|corners| area(*corners)).sum();
    faces.retain(|face| face.area >= LEAST_FRACTION * all);
    faces
}
