//! First order: what the lens does to rays near the axis.
//!
//! y–nu trace (Welford, "Aberrations of Optical Systems", ch. 3); in the y–z plane. After a mirror the index counts negative,
//! so that one formula serves refraction and reflection.

use crate::system::System;

/// A paraxial ray at every surface.
#[derive(Clone, Debug, PartialEq)]
pub struct Trace {
    /// Height at each surface, mm.
    pub heights: Vec<f64>,
    /// Angle (slope) in each gap: before the first surface, after it, ...
    pub angles: Vec<f64>,
}

impl Trace {
    /// From height `y` at the first surface with slope `u` before it; `n` as [`System::indices`].
    pub fn new(system: &System, n: &[f64], y: f64, u: f64) -> Trace {
        let mut heights = Vec::with_capacity(system.surfaces.len());
        let mut angles = vec![u];
        let (mut y, mut u) = (y, u);
        for (i, s) in system.surfaces.iter().enumerate() {
            if i > 0 {
                y += u * (s.z - system.surfaces[i - 1].z);
            }
            let (before, after) = (n[i] * system.runs[i], n[i + 1] * system.runs[i + 1]);
            u = (before * u - y * s.profile.curvature() * (after - before)) / after;
            heights.push(y);
            angles.push(u);
        }
        Trace { heights, angles }
    }

    /// Parallel to the axis at height 1.
    pub fn axial(system: &System, n: &[f64]) -> Trace {
        Trace::new(system, n, 1.0, 0.0)
    }

    fn last(&self) -> (f64, f64) {
        (self.heights.last().copied().unwrap_or(0.0), self.angles.last().copied().unwrap_or(0.0))
    }
}

/// First-order data. Places in mm along the axis from the first vertex; distances as CODE V prints them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FirstOrder {
    /// Effective focal length.
    pub efl: f64,
    /// From the last vertex to the rear focal point.
    pub bfl: f64,
    /// From the first vertex to the front focal point (negative: in front of it).
    pub ffl: f64,
    /// Place of the front principal plane.
    pub front_principal_z: f64,
    /// Place of the rear principal plane.
    pub rear_principal_z: f64,
    /// Place of the entrance pupil.
    pub entrance_pupil_z: f64,
    /// Entrance pupil radius over stop radius.
    pub entrance_pupil_magnification: f64,
    /// Place of the exit pupil; infinite for a telecentric lens.
    pub exit_pupil_z: f64,
    /// Exit pupil radius over stop radius.
    pub exit_pupil_magnification: f64,
    /// Radius of the stop as it stands, mm.
    pub stop_radius: f64,
    /// Σ −(n' − n) c / (n n'), 1/mm: minus the curvature of the Petzval surface.
    pub petzval_sum: f64,
}

impl FirstOrder {
    /// Of a system at the indices of one wavelength.
    pub fn of(system: &System, n: &[f64]) -> FirstOrder {
        let last_z = system.last_z();
        let axial = Trace::axial(system, n);
        let (y, u) = axial.last();
        let efl = -1.0 / u;
        let bfl = -y / u;
        // The other way round: a ray that leaves parallel to the axis, by linearity from the two basis rays.
        let slanted = Trace::new(system, n, 0.0, 1.0);
        let (_, us) = slanted.last();
        // y0 u + s us = 0 with slope 1 in front: height at the first vertex of the ray through the front focal point.
        let y0 = -us / u;
        let ffl = -y0;
        // Pupils: the ray through the middle of the stop.
        let (a, b) = (axial.heights[system.stop], slanted.heights[system.stop]);
        // y0' a + b = 0 for slope 1: crosses the axis at z = −y0'.
        let entrance_pupil_z = b / a;
        let chief_y = -b / a;
        let (cy, cu) = (chief_y * y + slanted.last().0, chief_y * u + us);
        let exit_pupil_z = last_z - cy / cu;
        // Invariant: n u_chief × pupil radius is the same in all spaces. With slope 1 in front at n = 1, and the slope at the
        // stop known, radius ratios follow.
        let stop_slope = chief_y * axial.angles[system.stop] + slanted.angles[system.stop];
        let n_stop = n[system.stop] * system.runs[system.stop];
        let n_last = n[system.surfaces.len()] * system.runs[system.surfaces.len()];
        let entrance_pupil_magnification = n_stop * stop_slope;
        let exit_pupil_magnification = n_stop * stop_slope / (n_last * cu);
        let petzval_sum = (0..system.surfaces.len())
            .map(|i| {
                let (n0, n1) = (n[i] * system.runs[i], n[i + 1] * system.runs[i + 1]);
                -(n1 - n0) * system.surfaces[i].profile.curvature() / (n0 * n1)
            })
            .sum();
        FirstOrder {
            efl: efl * system.runs[system.surfaces.len()],
            bfl,
            ffl,
            front_principal_z: ffl + efl * system.runs[system.surfaces.len()],
            rear_principal_z: last_z + bfl - efl,
            entrance_pupil_z,
            entrance_pupil_magnification,
            exit_pupil_z,
            exit_pupil_magnification,
            stop_radius: system.iris.radius,
            petzval_sum,
        }
    }

    /// Radius of the entrance pupil, mm.
    pub fn entrance_pupil_radius(&self) -> f64 {
        (self.entrance_pupil_magnification * self.stop_radius).abs()
    }

    /// Radius of the exit pupil, mm.
    pub fn exit_pupil_radius(&self) -> f64 {
        (self.exit_pupil_magnification * self.stop_radius).abs()
    }

    /// Effective focal length over entrance pupil diameter.
    pub fn f_number(&self) -> f64 {
        self.efl.abs() / (2.0 * self.entrance_pupil_radius())
    }
}
