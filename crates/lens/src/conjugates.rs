//! Object and image of a thin lens in air: the Gaussian lens formula and the transverse magnification.
//!
//! 1/f = 1/z_o + 1/z_i and m = −z_i / z_o. Distances are counted from the lens: z_o is positive before it (a real object), z_i positive behind it
//! (a real image, which a film can catch). A negative m is an image upside down. Source: Hecht, Optics, 5th ed., eqs. 5.17 and 5.25.

/// Two conjugate planes of a thin lens. An infinite distance is `f64::INFINITY`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Conjugates {
    /// Focal length, mm; negative of a diverging lens.
    pub focal_mm: f64,
    /// Object distance, mm.
    pub object_mm: f64,
    /// Image distance, mm.
    pub image_mm: f64,
    /// Transverse magnification; infinite with the object in the focal plane.
    pub magnification: f64,
}

/// What is known of a pair of conjugate planes: two of the four numbers of [`Conjugates`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Known {
    /// Focal length and object distance, mm.
    FocalObject(f64, f64),
    /// Focal length and image distance, mm.
    FocalImage(f64, f64),
    /// Focal length (mm) and magnification.
    FocalMagnification(f64, f64),
    /// Object and image distance, mm.
    ObjectImage(f64, f64),
    /// Object distance (mm) and magnification.
    ObjectMagnification(f64, f64),
    /// Image distance (mm) and magnification.
    ImageMagnification(f64, f64),
}

/// The distance whose reciprocal this is; infinite for zero.
fn distance_of(vergence: f64) -> f64 {
    if vergence == 0.0 { f64::INFINITY } else { 1.0 / vergence }
}

impl Conjugates {
    /// Finds the other two numbers. `None` where no lens does that: a focal length or a finite distance of 0, numbers that are not finite (but for
    /// distances), and pairs that would need a lens without power.
    pub fn of(known: Known) -> Option<Conjugates> {
        let distance = |v: f64| v != 0.0 && !v.is_nan();
        let finite = |v: f64| v != 0.0 && v.is_finite();
        match known {
            Known::FocalObject(f, o) if finite(f) && distance(o) => {
                let image = distance_of(1.0 / f - 1.0 / o);
                // −z_i / z_o without the quotient of two infinities: f / (f − z_o).
                let magnification = if o.is_infinite() { 0.0 } else { f / (f - o) };
                Some(Conjugates { focal_mm: f, object_mm: o, image_mm: image, magnification })
            }
            Known::FocalImage(f, i) if finite(f) && distance(i) => {
                let magnification = if i.is_infinite() { f64::INFINITY } else { (f - i) / f };
                Some(Conjugates { focal_mm: f, object_mm: distance_of(1.0 / f - 1.0 / i), image_mm: i, magnification })
            }
            Known::FocalMagnification(f, m) if finite(f) && finite(m) => {
                // At m = 1 object and image lie in the lens itself: nothing to build.
                let found = Conjugates { focal_mm: f, object_mm: f * (1.0 - 1.0 / m), image_mm: f * (1.0 - m), magnification: m };
                (m != 1.0).then_some(found)
            }
            Known::ObjectImage(o, i) if distance(o) && distance(i) => {
                let power = 1.0 / o + 1.0 / i;
                let magnification = match (o.is_infinite(), i.is_infinite()) {
                    (true, _) => 0.0,
                    (_, true) => f64::INFINITY,
                    _ => -i / o,
                };
                (power != 0.0).then(|| Conjugates { focal_mm: 1.0 / power, object_mm: o, image_mm: i, magnification })
            }
            Known::ObjectMagnification(o, m) if finite(o) && finite(m) && m != 1.0 => {
                Some(Conjugates { focal_mm: o * m / (m - 1.0), object_mm: o, image_mm: -m * o, magnification: m })
            }
            Known::ImageMagnification(i, m) if finite(i) && finite(m) && m != 1.0 => {
                Some(Conjugates { focal_mm: i / (1.0 - m), object_mm: -i / m, image_mm: i, magnification: m })
            }
            _ => None,
        }
    }

    /// Diameter (mm) of the blur that a point at `distance_mm` before the lens makes on a film in the image plane, through an aperture of `f_number`.
    /// `None` where no film can stand there: a virtual image, or one at infinity.
    ///
    /// C = A |1 − z_i (1/f − 1/d)| with A = |f| / N, by similar triangles; it also holds where the point has no real image. Source: Ray 2002,
    /// "Applied Photographic Optics", ch. 22.
    pub fn circle_mm(&self, f_number: f64, distance_mm: f64) -> Option<f64> {
        let film = self.image_mm;
        let circle = (self.focal_mm / f_number).abs() * (1.0 - film * (1.0 / self.focal_mm - 1.0 / distance_mm)).abs();
        (film > 0.0 && film.is_finite()).then_some(circle)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn any_two_numbers_give_the_others() {
        // Converging and diverging; real and virtual images; objects within the focal length.
        for (f, o) in [(50.0, 2000.0), (50.0, 100.0), (50.0, 30.0), (-80.0, 240.0), (105.0, 157.5), (50.0, -70.0)] {
            let a = Conjugates::of(Known::FocalObject(f, o)).unwrap();
            assert!((1.0 / a.object_mm + 1.0 / a.image_mm - 1.0 / f).abs() < 1e-15, "{a:?}");
            assert!((a.magnification + a.image_mm / a.object_mm).abs() < 1e-12 * a.magnification.abs().max(1.0), "{a:?}");
            let (i, m) = (a.image_mm, a.magnification);
            for known in [
                Known::FocalImage(f, i),
                Known::FocalMagnification(f, m),
                Known::ObjectImage(o, i),
                Known::ObjectMagnification(o, m),
                Known::ImageMagnification(i, m),
            ] {
                let b = Conjugates::of(known).unwrap();
                for (x, y) in [
                    (a.focal_mm, b.focal_mm),
                    (a.object_mm, b.object_mm),
                    (a.image_mm, b.image_mm),
                    (a.magnification, b.magnification),
                ] {
                    // Differences of nearly equal reciprocals lose some digits.
                    assert!((x - y).abs() < 1e-9 * x.abs(), "{known:?}: {a:?} {b:?}");
                }
            }
        }
    }

    #[test]
    fn infinity_and_the_focal_plane_belong_together() {
        let far = Conjugates::of(Known::FocalObject(50.0, f64::INFINITY)).unwrap();
        assert_eq!((far.image_mm, far.magnification), (50.0, 0.0));
        let near = Conjugates::of(Known::FocalObject(50.0, 50.0)).unwrap();
        assert!(near.image_mm.is_infinite() && near.magnification.is_infinite());
        assert_eq!(Conjugates::of(Known::ObjectImage(f64::INFINITY, 35.0)).unwrap().focal_mm, 35.0);
        assert_eq!(Conjugates::of(Known::FocalImage(50.0, 50.0)).unwrap().object_mm, f64::INFINITY);
    }

    #[test]
    fn what_no_lens_does_has_no_answer() {
        for known in [
            Known::FocalObject(0.0, 100.0),
            Known::FocalObject(50.0, 0.0),
            Known::FocalObject(f64::INFINITY, 100.0),
            Known::FocalMagnification(50.0, 0.0),
            Known::FocalMagnification(50.0, 1.0),
            Known::ObjectImage(100.0, -100.0),
            Known::ObjectMagnification(f64::INFINITY, -1.0),
            Known::ObjectMagnification(100.0, 1.0),
            Known::ImageMagnification(100.0, 1.0),
        ] {
            assert_eq!(Conjugates::of(known), None, "{known:?}");
        }
    }

    #[test]
    fn circles_follow_from_similar_triangles() {
        // 50 mm f/2 focused at 3 m: film at 150/2.95 mm; the image of 1 m lies at 50/0.95 mm.
        let sharp = Conjugates::of(Known::FocalObject(50.0, 3000.0)).unwrap();
        let (film, image) = (150.0 / 2.95, 50.0 / 0.95);
        let expected = 25.0 * (image - film) / image;
        assert!((sharp.circle_mm(2.0, 1000.0).unwrap() - expected).abs() < 1e-12);
        assert!(sharp.circle_mm(2.0, 3000.0).unwrap() < 1e-12);
        // A point in the focal plane leaves the lens as parallel light: a circle as wide as the aperture.
        assert!((sharp.circle_mm(2.0, 50.0).unwrap() - 25.0).abs() < 1e-12);
        assert_eq!(Conjugates::of(Known::FocalObject(50.0, 30.0)).unwrap().circle_mm(2.0, 1000.0), None);
    }
}
