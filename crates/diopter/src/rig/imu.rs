//! What an inertial measurement unit on a rig feels: angular rate and specific force, exact along the path of the rig, and with the noise of a real one.
//!
//! Axes are the IMU's own. The angular rate is that of the body against the world, in body axes, rad/s (right-handed: positive about +y turns −z towards −x). The specific force is what
//! an accelerometer measures, f = Rᵀ (a − g), in body axes, m/s²: an IMU at rest reads +9.81 upwards. Noise is the model of Kalibr and of IEEE Std 952: white noise of a density
//! (σ / √Hz; each sample has σ √rate), a bias that walks (its step from sample to sample has σ_b / √rate), and a bias of its own at every start.
//! Source: IEEE Std 952-1997, annex C; Kalibr wiki, "IMU Noise Model".

use super::path::RigPath;
use crate::calibration::number;
use diopter_sensor::noise::{mix, normal_quantile, unit};
use glam::{DAffine3, DQuat, DVec3};
use std::fmt::Write;
use std::sync::Arc;

/// Standard gravity, m/s² (ISO 80000-3).
pub const STANDARD_GRAVITY: f64 = 9.80665;

/// Noise of three axes of one kind.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct AxisNoise {
    /// White noise: unit / √Hz (gyroscope rad/s/√Hz, accelerometer m/s²/√Hz); the Allan deviation is this over √τ.
    pub density: f64,
    /// Random walk of the bias: unit · √Hz (rad/s²/√Hz, m/s³/√Hz); the Allan deviation is this times √(τ / 3).
    pub random_walk: f64,
    /// Standard deviation of the bias at the start, unit.
    pub turn_on: f64,
}

/// An IMU on a rig.
#[derive(Clone, Debug)]
pub struct Imu {
    /// Samples a second.
    pub rate_hz: f64,
    /// Rig from IMU, m.
    pub rig_from_imu: DAffine3,
    /// Acceleration of free fall in the world, m/s².
    pub gravity: DVec3,
    /// Noise of the gyroscope.
    pub gyro: AxisNoise,
    /// Noise of the accelerometer.
    pub accel: AxisNoise,
    /// What all noise follows from.
    pub seed: u64,
}

/// What an IMU feels at a moment, and what it says.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImuSample {
    /// Scene time, s.
    pub time_s: f64,
    /// World from IMU.
    pub place: DAffine3,
    /// In the world, m/s.
    pub velocity: DVec3,
    /// True angular rate, body axes, rad/s.
    pub angular_rate: DVec3,
    /// True specific force, body axes, m/s².
    pub specific_force: DVec3,
    /// Biases of gyroscope and accelerometer.
    pub bias: [DVec3; 2],
    /// What gyroscope and accelerometer say: truth, bias and noise.
    pub measured: [DVec3; 2],
}

impl Imu {
    /// Samples from a moment to another, s, at equal steps of the rate, the first at `from_s`, none after `to_s`.
    pub fn samples(&self, path: &Arc<RigPath>, from_s: f64, to_s: f64) -> Vec<ImuSample> {
        let count = ((to_s - from_s) * self.rate_hz + 1e-9).floor() as u64 + 1;
        let normal = |what: u64, k: u64| {
            let key = mix(self.seed, what);
            DVec3::from_array([0, 1, 2].map(|axis| normal_quantile(unit(mix(key, 3 * k + axis)))))
        };
        let root = self.rate_hz.sqrt();
        let kinds = [self.gyro, self.accel];
        let mut bias = [0, 1].map(|i| normal(i, 0) * kinds[i as usize].turn_on);
        let mut all = Vec::new();
        for k in 0..count {
            let time_s = from_s + k as f64 / self.rate_hz;
            let state = path.at(time_s).carried(&self.rig_from_imu);
            let specific_force = state.place.matrix3.transpose() * (state.acceleration - self.gravity);
            let truth = [state.angular_rate, specific_force];
            let measured = [0, 1].map(|i| truth[i] + bias[i] + normal(2 + i as u64, k) * (kinds[i].density * root));
            all.push(ImuSample {
                time_s,
                place: state.place,
                velocity: state.velocity,
                angular_rate: truth[0],
                specific_force: truth[1],
                bias,
                measured,
            });
            for i in 0..2 {
                bias[i] += normal(4 + i as u64, k) * (kinds[i].random_walk / root);
            }
        }
        all
    }

    /// Kalibr's description of the IMU (`imu.yaml`). Numbers without exponents: YAML 1.1, by which Kalibr reads, takes `2e-3` for a text.
    pub fn kalibr(&self) -> String {
        let all = [self.accel.density, self.accel.random_walk, self.gyro.density, self.gyro.random_walk];
        // What stands there is what the samples have.
        let note = if all.contains(&0.0) {
            "# Kalibr wants numbers above 0 here: those of 0 are of an IMU without this noise.\n"
        } else {
            ""
        };
        let [accel, accel_walk, gyro, gyro_walk] = all.map(number);
        format!(
            "{note}accelerometer_noise_density: {accel}\naccelerometer_random_walk: {accel_walk}\ngyroscope_noise_density: {gyro}\n\
             gyroscope_random_walk: {gyro_walk}\nrostopic: /imu0\nupdate_rate: {}\n",
            number(self.rate_hz)
        )
    }
}

/// Nanoseconds of a scene time.
pub fn nanoseconds(time_s: f64) -> i64 {
    (time_s * 1e9).round() as i64
}

/// `imu0/data.csv` of EuRoC: what the IMU says, or with `truth` what it feels. Source: Burri et al. 2016, "The EuRoC micro aerial vehicle datasets", file format.
pub fn euroc_imu(samples: &[ImuSample], truth: bool) -> String {
    let mut text = String::from(
        "#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1],a_RS_S_x [m s^-2],a_RS_S_y [m s^-2],a_RS_S_z [m s^-2]\n",
    );
    for s in samples {
        let [w, a] = if truth { [s.angular_rate, s.specific_force] } else { s.measured };
        let _ = writeln!(text, "{},{},{},{},{},{},{}", nanoseconds(s.time_s), w.x, w.y, w.z, a.x, a.y, a.z);
    }
    text
}

/// `state_groundtruth_estimate0/data.csv` of EuRoC: where the IMU is, its velocity and biases; the quaternion turns body axes into the world's.
pub fn euroc_truth(samples: &[ImuSample]) -> String {
    let mut text = String::from(
        "#timestamp, p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z [], v_RS_R_x [m s^-1], v_RS_R_y [m s^-1], \
         v_RS_R_z [m s^-1], b_w_RS_S_x [rad s^-1], b_w_RS_S_y [rad s^-1], b_w_RS_S_z [rad s^-1], b_a_RS_S_x [m s^-2], b_a_RS_S_y [m s^-2], b_a_RS_S_z [m s^-2]\n",
    );
    for s in samples {
        let (q, p, v) = (DQuat::from_mat3(&s.place.matrix3).normalize(), s.place.translation, s.velocity);
        let numbers = [p.x, p.y, p.z, q.w, q.x, q.y, q.z, v.x, v.y, v.z];
        let biases = s.bias.iter().flat_map(|b| b.to_array());
        let _ = write!(text, "{}", nanoseconds(s.time_s));
        for n in numbers.into_iter().chain(biases) {
            let _ = write!(text, ",{n}");
        }
        text.push('\n');
    }
    text
}

/// The numbers of samples, a row each: time (s), what the IMU says (rate, force), what is true (rate, force), biases (rate, force), position, quaternion (w x y z), velocity.
pub const COLUMNS: usize = 1 + 6 + 6 + 6 + 3 + 4 + 3;

/// `[sample][column]`; see [`COLUMNS`].
pub fn table(samples: &[ImuSample]) -> Vec<f64> {
    let mut out = Vec::with_capacity(samples.len() * COLUMNS);
    for s in samples {
        let q = DQuat::from_mat3(&s.place.matrix3).normalize();
        out.push(s.time_s);
        let vectors = [s.measured[0], s.measured[1], s.angular_rate, s.specific_force, s.bias[0], s.bias[1], s.place.translation];
        vectors.iter().for_each(|v| out.extend(v.to_array()));
        out.extend([q.w, q.x, q.y, q.z]);
        out.extend(s.velocity.to_array());
    }
    out
}

#[cfg(test)]
mod tests {
    use super::super::path::{Ends, tests::winding};
    use super::*;

    fn imu(rate_hz: f64) -> Imu {
        Imu {
            rate_hz,
            rig_from_imu: DAffine3::from_rotation_translation(DQuat::from_rotation_z(0.3), DVec3::new(0.05, -0.1, 0.02)),
            gravity: DVec3::NEG_Y * STANDARD_GRAVITY,
            gyro: AxisNoise::default(),
            accel: AxisNoise::default(),
            seed: 1,
        }
    }

    #[test]
    fn integrating_the_truth_gives_the_pose_back() {
        let path = Arc::new(winding());
        let error = |rate: f64| {
            let samples = imu(rate).samples(&path, 0.0, 2.0);
            let dt = 1.0 / rate;
            let first = samples[0];
            let (mut q, mut p, mut v) = (DQuat::from_mat3(&first.place.matrix3), first.place.translation, first.velocity);
            // Trapezoids of rate and force: what pre-integration does (Forster et al. 2017), with the mean of two samples.
            for w in samples.windows(2) {
                let turn = DQuat::from_scaled_axis((w[0].angular_rate + w[1].angular_rate) * (0.5 * dt));
                let next = (q * turn).normalize();
                let force = (q * w[0].specific_force + next * w[1].specific_force) * 0.5;
                let a = force + DVec3::NEG_Y * STANDARD_GRAVITY;
                p += v * dt + a * (0.5 * dt * dt);
                v += a * dt;
                q = next;
            }
            let last = samples[samples.len() - 1];
            assert!((last.time_s - 2.0).abs() < 1e-9);
            let angle = q.angle_between(DQuat::from_mat3(&last.place.matrix3).normalize());
            [(p - last.place.translation).length(), angle]
        };
        let (coarse, fine) = (error(200.0), error(2000.0));
        // 1.7 µm and 3.4e-7 rad after 2 s at 2 kHz, as the same formulas in another program say; and as trapezoids are of second order, 200 Hz is 100 times worse (within a
        // factor of two).
        assert!(fine[0] < 4e-6 && fine[1] < 1e-6, "{fine:?}");
        assert!((50.0..200.0).contains(&(coarse[0] / fine[0])), "{coarse:?} {fine:?}");
    }

    #[test]
    fn at_rest_it_reads_gravity_upwards() {
        let turn = DQuat::from_rotation_z(0.5);
        let still = RigPath::new(&[(0.0, DAffine3::from_quat(turn))], Ends::Rest).unwrap();
        let unit = Imu { rig_from_imu: DAffine3::IDENTITY, ..imu(100.0) };
        let s = unit.samples(&Arc::new(still), 0.0, 0.05);
        assert_eq!(s.len(), 6);
        assert!((s[0].specific_force - turn.inverse() * DVec3::Y * STANDARD_GRAVITY).length() < 1e-12);
        assert_eq!(s[0].angular_rate, DVec3::ZERO);
        let text = euroc_imu(&s, false);
        assert!(text.lines().nth(2).is_some_and(|l| l.starts_with("10000000,")), "{text}");
        assert_eq!(euroc_truth(&s).lines().nth(1).map(|l| l.split(',').count()), Some(17));
        assert_eq!(table(&s).len(), 6 * COLUMNS);
    }

    /// Allan deviation of a cluster of `m` samples, not overlapping (IEEE Std 952-1997, C.1).
    fn allan(values: &[f64], m: usize) -> (f64, f64) {
        let means: Vec<f64> = values.chunks_exact(m).map(|c| c.iter().sum::<f64>() / m as f64).collect();
        let n = means.len() as f64 - 1.0;
        let sum: f64 = means.windows(2).map(|w| (w[1] - w[0]).powi(2)).sum();
        // Its own relative error: 1 / √(2 n), somewhat more as neighbours share a mean.
        ((0.5 * sum / n).sqrt(), (1.5 / (2.0 * n)).sqrt())
    }

    #[test]
    fn kalibr_reads_all_numbers_as_numbers() {
        let noise = |density, random_walk| AxisNoise { density, random_walk, turn_on: 0.0 };
        let text = Imu { accel: noise(2e-3, 3e-5), gyro: noise(1.7e-4, 0.0), ..imu(200.0) }.kalibr();
        let of = |key: &str| text.lines().find_map(|l| l.strip_prefix(key)?.strip_prefix(": ")).unwrap();
        let all =
            ["accelerometer_noise_density", "accelerometer_random_walk", "gyroscope_noise_density", "gyroscope_random_walk"]
                .map(of);
        // YAML 1.1 wants a point, and digits alone do not do behind an exponent.
        assert_eq!((all, of("update_rate")), (["0.002", "0.00003", "0.00017", "0.0"], "200.0"));
        assert!(text.starts_with("# Kalibr wants numbers above 0"));
    }

    #[test]
    fn the_allan_deviation_is_that_of_the_parameters() {
        let still = Arc::new(RigPath::new(&[(0.0, DAffine3::IDENTITY)], Ends::Rest).unwrap());
        let (density, walk) = (1e-3, 2e-3);
        let with = |density: f64, random_walk: f64| {
            let noise = AxisNoise { density, random_walk, turn_on: 0.0 };
            let unit = Imu { gyro: noise, ..imu(100.0) };
            unit.samples(&still, 0.0, 2000.0).iter().map(|s| s.measured[0].x).collect::<Vec<f64>>()
        };
        let (white, walking) = (with(density, 0.0), with(0.0, walk));
        for m in [10usize, 100, 1000] {
            let tau = m as f64 / 100.0;
            let (found, error) = allan(&white, m);
            assert!((found / (density / tau.sqrt()) - 1.0).abs() < 4.0 * error, "white, {tau} s: {found}");
            let (found, error) = allan(&walking, m);
            // Steps of 10 ms: 1 + 1 / (2 m²) times the continuous one.
            assert!((found / (walk * (tau / 3.0).sqrt()) - 1.0).abs() < 4.0 * error + 0.006, "walk, {tau} s: {found}");
        }
        // Turn-on biases of many seeds: their deviation within four standard errors of 500 × 3 numbers.
        let biases: Vec<f64> = (0..500)
            .flat_map(|seed| {
                let unit = Imu { gyro: AxisNoise { turn_on: 0.5, ..Default::default() }, seed, ..imu(100.0) };
                unit.samples(&still, 0.0, 0.0)[0].measured[0].to_array()
            })
            .collect();
        let sd = (biases.iter().map(|b| b * b).sum::<f64>() / biases.len() as f64).sqrt();
        assert!((sd / 0.5 - 1.0).abs() < 4.0 / (2.0 * biases.len() as f64).sqrt(), "{sd}");
    }
}
