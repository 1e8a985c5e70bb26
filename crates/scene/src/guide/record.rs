//! What a path of the training met: where it went from each surface, with which density, and what light came back.

use super::quadtree::square_of;
use super::spatial::{Place, place};
use diopter_light::Sampled;
use glam::Vec3;

/// Vertices that are kept of a path.
const MOST_VERTICES: usize = 32;

/// A surface that a path was scattered by.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Vertex {
    /// Where, m.
    pub point: Vec3,
    /// Normal on the side of the path.
    pub normal: Vec3,
    /// Where it went: unit direction away from the surface.
    pub direction: Vec3,
    /// Density with which it was drawn, 1/sr.
    pub pdf: f32,
    /// Density that the scattering function alone has for it.
    pub bsdf_pdf: f32,
    /// f cos θ / pdf.
    pub weight: Sampled,
    /// Of the path behind it, before roulette.
    pub throughput: Sampled,
    /// Of the path so far, with what was aimed at from this vertex.
    pub radiance: Sampled,
}

/// Notes of a path, written by the path tracer.
#[derive(Clone, Debug, Default)]
pub(crate) struct PathRecord {
    /// Rays of the path, shadow rays not counted.
    pub segments: u32,
    /// Light of caustics by photons that is part of the path's.
    pub gathered: Sampled,
    vertices: Vec<Vertex>,
}

/// What a vertex tells about the light.
#[derive(Clone, Copy, Debug)]
pub(super) struct Record {
    pub place: Place,
    /// Direction, in the square.
    pub direction: [f32; 2],
    pub pdf: f32,
    pub bsdf_pdf: f32,
    /// Radiance that arrived times the cosine of its angle, mean of the wavelengths.
    pub light: f32,
    /// Radiance that arrived times f cos θ.
    pub reflected: f32,
}

impl PathRecord {
    /// Forgets the path before.
    pub fn clear(&mut self) {
        self.segments = 0;
        self.gathered = Sampled::ZERO;
        self.vertices.clear();
    }

    /// Notes a vertex.
    pub fn push(&mut self, vertex: Vertex) {
        if self.vertices.len() < MOST_VERTICES {
            self.vertices.push(vertex);
        }
    }

    /// The light that arrived at each vertex, by the radiance of the whole path: what was found beyond, weighed against next-event estimation
    /// as it was, is the part that scattered directions must find.
    pub(super) fn records(&self, radiance: Sampled) -> impl Iterator<Item = Record> + '_ {
        let of = move |v: &Vertex| {
            let (mut light, mut reflected, mut lanes) = (0.0, 0.0, 0.0);
            for k in 0..4 {
                // Wavelengths that the path has lost tell nothing.
                if v.throughput[k] > 0.0 {
                    let arrived = ((radiance[k] - v.radiance[k]) / v.throughput[k]).max(0.0);
                    light += arrived;
                    reflected += arrived * v.weight[k] * v.pdf;
                    lanes += 1.0;
                }
            }
            let record = Record {
                place: place(v.point, v.normal),
                direction: square_of(v.direction),
                pdf: v.pdf,
                bsdf_pdf: v.bsdf_pdf,
                light: light / lanes * v.normal.dot(v.direction).abs(),
                reflected: reflected / lanes,
            };
            let whole = record.light.is_finite() && record.reflected.is_finite() && v.pdf > 0.0 && v.pdf.is_finite();
            whole.then_some(record)
        };
        self.vertices.iter().filter_map(of)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn light_is_what_the_path_found_beyond_a_vertex() {
        let mut path = PathRecord::default();
        let vertex = Vertex {
            point: Vec3::ZERO,
            normal: Vec3::Z,
            direction: Vec3::new(0.6, 0.0, 0.8),
            pdf: 2.0,
            bsdf_pdf: 1.0,
            weight: Sampled::splat(0.5),
            throughput: Sampled::new(0.5, 0.25, 0.0, 0.5),
            radiance: Sampled::splat(1.0),
        };
        path.push(vertex);
        path.push(Vertex { throughput: Sampled::ZERO, ..vertex });
        let records: Vec<Record> = path.records(Sampled::new(2.0, 2.0, 9.0, 1.0)).collect();
        // Radiances (2, 4, lost, 0); the second vertex has lost all wavelengths.
        assert_eq!(records.len(), 1);
        assert!((records[0].light - 2.0 * 0.8).abs() < 1e-6 && (records[0].reflected - 2.0).abs() < 1e-6, "{records:?}");
        (0..100).for_each(|_| path.push(vertex));
        assert_eq!(path.records(Sampled::ONE).count(), MOST_VERTICES - 1);
        path.clear();
        assert_eq!((path.records(Sampled::ONE).count(), path.segments), (0, 0));
    }
}
