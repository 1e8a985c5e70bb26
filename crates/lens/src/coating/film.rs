//! What a bare surface, one quarter-wave film of magnesium fluoride and evaporated aluminium let pass and reflect.

/// Fresnel's transmitted fraction of unpolarised light. `n0`, `n1`: indices before and after; `c0`, `c1`: cosines of incidence
/// and refraction. Source: Born & Wolf §1.5.
pub fn fresnel(n0: f64, n1: f64, [c0, c1]: [f64; 2]) -> f64 {
    let s = (n0 * c0 - n1 * c1) / (n0 * c0 + n1 * c1);
    let p = (n1 * c0 - n0 * c1) / (n1 * c0 + n0 * c1);
    1.0 - 0.5 * (s * s + p * p)
}

/// Index of a film of magnesium fluoride.
pub(crate) const MGF2: f64 = 1.38;
/// The wavelength whose quarter the film is thick, nm.
pub(crate) const FILM_NM: f64 = 550.0;

/// One film of MgF₂, a quarter wave at [`FILM_NM`] and normal incidence (Airy's sum; Born & Wolf §1.6).
pub(crate) fn quarter_wave(n0: f64, n1: f64, [c0, c1]: [f64; 2], nm: f64) -> f64 {
    let sin2 = (n0 / MGF2).powi(2) * (1.0 - c0 * c0);
    let cf = (1.0 - sin2).max(0.0).sqrt();
    let phase = std::f64::consts::PI * FILM_NM / nm * cf;
    let reflected = |r1: f64, r2: f64| {
        let x = 2.0 * r1 * r2 * phase.cos();
        (r1 * r1 + r2 * r2 + x) / (1.0 + r1 * r1 * r2 * r2 + x)
    };
    let rs = |a: f64, ca: f64, b: f64, cb: f64| (a * ca - b * cb) / (a * ca + b * cb);
    let rp = |a: f64, ca: f64, b: f64, cb: f64| (b * ca - a * cb) / (b * ca + a * cb);
    let s = reflected(rs(n0, c0, MGF2, cf), rs(MGF2, cf, n1, c1));
    let p = reflected(rp(n0, c0, MGF2, cf), rp(MGF2, cf, n1, c1));
    1.0 - 0.5 * (s + p)
}

/// Reflectance of evaporated aluminium at normal incidence, from n and k of Rakić 1995 (doi 10.1364/AO.34.004755).
pub(crate) fn aluminium(nm: f64) -> f64 {
    const R: [f64; 11] = [0.9243, 0.9233, 0.921, 0.9185, 0.916, 0.9129, 0.9096, 0.904, 0.8973, 0.8881, 0.8751];
    let x = ((nm - 380.0) / 40.0).clamp(0.0, 9.999_999);
    let i = x as usize;
    R[i] + (R[i + 1] - R[i]) * (x - i as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn surfaces_lose_what_the_textbook_says() {
        // 4 % at n = 1.5; nothing of p at Brewster's angle; MgF2 on 1.5: ((1.38² − 1.5)/(1.38² + 1.5))² = 1.41 %.
        assert!((fresnel(1.0, 1.5, [1.0, 1.0]) - 0.96).abs() < 1e-12);
        let brewster = 1.5f64.atan();
        let c1 = (1.0 - (brewster.sin() / 1.5).powi(2)).sqrt();
        let s = (brewster.cos() - 1.5 * c1) / (brewster.cos() + 1.5 * c1);
        assert!((fresnel(1.0, 1.5, [brewster.cos(), c1]) - (1.0 - 0.5 * s * s)).abs() < 1e-12);
        let expected = 1.0 - ((MGF2 * MGF2 - 1.5) / (MGF2 * MGF2 + 1.5)).powi(2);
        assert!((quarter_wave(1.0, 1.5, [1.0, 1.0], 550.0) - expected).abs() < 1e-12);
        // The same from the other side.
        assert!((quarter_wave(1.5, 1.0, [1.0, 1.0], 550.0) - expected).abs() < 1e-12);
    }
}
