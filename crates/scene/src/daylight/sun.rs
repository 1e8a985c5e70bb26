//! Where the sun is seen from a place on earth.
//!
//! Source: J. Meeus, "Astronomical Algorithms" 2nd ed., ch. 12, 13, 25 (low accuracy, 0.01°); refraction by Sæmundsson (ch. 16).

/// Where the sun is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// Above the horizon, as seen through the air, rad.
    pub elevation: f64,
    /// From north towards east, rad.
    pub azimuth: f64,
    /// Astronomical units.
    pub distance_au: f64,
}

/// Days from noon of 2000-01-01 (J2000) to a moment of the Gregorian calendar in universal time: year, month and day counted from 1, seconds of the day.
pub fn days_since_2000(year: i64, month: i64, day: i64, seconds: f64) -> f64 {
    // Source: Meeus, ch. 7.
    let (y, m) = if month <= 2 { (year - 1, month + 12) } else { (year, month) };
    let century = y.div_euclid(100);
    let leap = 2 - century + century.div_euclid(4);
    let julian = (365.25 * (y + 4716) as f64).floor() + (30.6001 * (m + 1) as f64).floor() + (day + leap) as f64 - 1524.5;
    julian - 2_451_545.0 + seconds / 86_400.0
}

/// The sun at a moment ([`days_since_2000`], days of universal time) from a latitude and a longitude (north and east positive, rad), refracted by the air at 1010 hPa and
/// 10 °C.
pub fn place(days: f64, latitude: f64, longitude: f64) -> Place {
    // Universal and dynamical time differ by about 70 s, in which the sun moves 0.0008°.
    let t = (days + 70.0 / 86_400.0) / 36_525.0;
    let degrees = |x: f64| x.rem_euclid(360.0).to_radians();
    let mean_longitude = 280.46646 + 36_000.769_83 * t + 0.000_303_2 * t * t;
    let anomaly = degrees(357.529_11 + 35_999.050_29 * t - 0.000_153_7 * t * t);
    let eccentricity = 0.016_708_634 - 0.000_042_037 * t;
    let center = (1.914_602 - 0.004_817 * t) * anomaly.sin()
        + (0.019_993 - 0.000_101 * t) * (2.0 * anomaly).sin()
        + 0.000_289 * (3.0 * anomaly).sin();
    let distance_au =
        1.000_001_018 * (1.0 - eccentricity * eccentricity) / (1.0 + eccentricity * (anomaly + center.to_radians()).cos());
    let node = degrees(125.04 - 1934.136 * t);
    let longitude_of_sun = degrees(mean_longitude + center - 0.005_69 - 0.004_78 * node.sin());
    let obliquity = (23.439_291 - 0.013_004_2 * t + 0.002_56 * node.cos()).to_radians();
    let ascension = (obliquity.cos() * longitude_of_sun.sin()).atan2(longitude_of_sun.cos());
    let declination = (obliquity.sin() * longitude_of_sun.sin()).asin();
    let t_ut = days / 36_525.0;
    let sidereal = degrees(
        280.460_618_37 + 360.985_647_366_29 * days + 0.000_387_933 * t_ut * t_ut - 0.004_78 * node.sin() * obliquity.cos(),
    );
    let hour = sidereal + longitude - ascension;
    let (sin_p, cos_p) = latitude.sin_cos();
    let true_elevation = (sin_p * declination.sin() + cos_p * declination.cos() * hour.cos()).clamp(-1.0, 1.0).asin();
    let azimuth = (hour.sin() * declination.cos()).atan2(hour.cos() * declination.cos() * sin_p - declination.sin() * cos_p)
        + std::f64::consts::PI;
    // As seen from the surface of the earth, not from its middle.
    let geometric = true_elevation.to_degrees() - 8.794 / 3600.0 / distance_au * true_elevation.cos();
    Place {
        elevation: (geometric + refraction(geometric)).to_radians(),
        azimuth: azimuth.rem_euclid(std::f64::consts::TAU),
        distance_au,
    }
}

/// How much the air lifts what is at a true elevation, degrees; at 1010 hPa and 10 °C. Fades out below the horizon, where no formula holds.
fn refraction(elevation_deg: f64) -> f64 {
    let h = elevation_deg.max(-1.0);
    let lift = 1.02 / 60.0 / (h + 10.3 / (h + 5.11)).to_radians().tan();
    lift.max(0.0) * ((elevation_deg + 6.0) / 5.0).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sun_is_where_published_examples_have_it() {
        // I. Reda, A. Andreas 2003 (NREL/TP-560-34302): 2003-10-17 12:30:30 at UTC − 7, zenith 50.11162° (820 hPa, 11 °C), azimuth 194.34024°.
        let days = days_since_2000(2003, 10, 17, (19.0 * 60.0 + 30.0) * 60.0 + 30.0);
        let sun = place(days, 39.742_476f64.to_radians(), (-105.1786f64).to_radians());
        assert!((90.0 - sun.elevation.to_degrees() - 50.11162).abs() < 0.012, "{}", 90.0 - sun.elevation.to_degrees());
        assert!((sun.azimuth.to_degrees() - 194.34024).abs() < 0.012, "{}", sun.azimuth.to_degrees());
        // Meeus, example 25.a: 1992-10-13 0 h, distance 0.99766.
        assert!((place(days_since_2000(1992, 10, 13, 0.0), 0.0, 0.0).distance_au - 0.99766).abs() < 1e-4);
        // Meeus, example 7.a: 1957-10-04.81 is JD 2436116.31.
        assert!((days_since_2000(1957, 10, 4, 0.81 * 86_400.0) + 2_451_545.0 - 2_436_116.31).abs() < 1e-6);
    }

    #[test]
    fn noon_and_seasons_are_right_on_both_halves_of_the_earth() {
        let at =
            |month, hour: f64, latitude: f64| place(days_since_2000(2026, month, 21, hour * 3600.0), latitude.to_radians(), 0.0);
        let summer = at(6, 12.03, 51.5);
        assert!((summer.elevation.to_degrees() - (90.0 - 51.5 + 23.44)).abs() < 0.1, "{}", summer.elevation.to_degrees());
        assert!((summer.azimuth.to_degrees() - 180.0).abs() < 1.0);
        let south = at(6, 12.03, -35.0);
        assert!((south.elevation.to_degrees() - (90.0 - 35.0 - 23.44)).abs() < 0.1);
        assert!(south.azimuth.to_degrees() < 1.0 || south.azimuth.to_degrees() > 359.0);
        assert!((at(6, 6.0, 51.5).azimuth.to_degrees() - 73.0).abs() < 3.0, "mornings are in the east");
        assert!(at(12, 0.0, 51.5).elevation < -1.0);
    }
}
