use super::*;

fn model(kind: ModelKind, coefficients: &[f64]) -> CameraModel {
    CameraModel::new(kind, DVec2::new(800.0, 790.0), DVec2::new(639.5, 360.25), coefficients.to_vec()).unwrap()
}

/// Every model with coefficients as calibrations find them.
fn all() -> Vec<CameraModel> {
    let cv = [-0.28, 0.09, 0.0007, -0.0004, -0.012, 0.02, -0.01, 0.003, 0.0005, -0.0002, -0.0003, 0.0001, 0.012, -0.008];
    vec![
        model(ModelKind::Pinhole, &[]),
        model(ModelKind::SimpleRadial, &[-0.1]),
        model(ModelKind::Radial, &[-0.2, 0.05]),
        model(ModelKind::OpenCv4, &cv[..4]),
        model(ModelKind::OpenCv5, &cv[..5]),
        model(ModelKind::OpenCv8, &cv[..8]),
        model(ModelKind::OpenCv12, &cv[..12]),
        model(ModelKind::OpenCv14, &cv),
        model(ModelKind::Fisheye, &[-0.01, 0.004, -0.003, 0.0005]),
        model(ModelKind::ThinPrismFisheye, &[-0.01, 0.004, 0.0003, -0.0002, -0.001, 0.0002, 0.0004, -0.0003]),
        model(ModelKind::FTheta, &[0.002, -0.03, 0.004, -0.001]),
        model(ModelKind::DoubleSphere, &[-0.2, 0.6]),
        model(ModelKind::Division, &[-0.15]),
        model(ModelKind::Equidistant, &[]),
        model(ModelKind::Equisolid, &[]),
        model(ModelKind::Stereographic, &[]),
        model(ModelKind::Orthographic, &[]),
    ]
}

fn towards(angle: f64, around: f64) -> DVec3 {
    (DVec2::from_angle(around) * angle.sin()).extend(angle.cos())
}

#[test]
fn unproject_undoes_project() {
    for model in all() {
        // A little within the range: at its end the slope is 0 and places tell nothing.
        let end = (0.97 * model.largest_angle()).min(1.8);
        for i in 0..=20 {
            for around in [0.1, 1.9, 4.0, 5.5] {
                let direction = towards(end * f64::from(i) / 20.0, around);
                let pixel = model.project(direction).unwrap();
                let back = model.unproject(pixel).unwrap_or_else(|| panic!("{} {direction}", model.kind().name()));
                // Rounding of places of about 1e3 px over slopes of a few percent.
                assert!((back - direction).length() < 1e-10, "{} {direction} {back}", model.kind().name());
            }
        }
    }
}

#[test]
fn fisheyes_have_the_radii_of_their_formulas() {
    let f = 800.0;
    for (kind, radius) in [
        (ModelKind::Equidistant, (|t: f64| t) as fn(f64) -> f64),
        (ModelKind::Equisolid, |t| 2.0 * (0.5 * t).sin()),
        (ModelKind::Stereographic, |t| 2.0 * (0.5 * t).tan()),
        (ModelKind::Orthographic, f64::sin),
    ] {
        for t in [0.0, 1e-9, 1e-4, 0.5, 1.2, 1.57] {
            let at = model(kind, &[]).project(towards(t, 0.0)).unwrap() - DVec2::new(639.5, 360.25);
            assert!((at.x - f * radius(t)).abs() < 1e-9 && at.y.abs() < 1e-9, "{kind:?} {t}: {at}");
        }
    }
    // Half a turn and beyond 90°.
    let behind = model(ModelKind::Equisolid, &[]).project(towards(2.5, 0.0)).unwrap();
    assert!((behind.x - 639.5 - 1600.0 * 1.25f64.sin()).abs() < 1e-9);
    assert_eq!(model(ModelKind::Orthographic, &[]).project(towards(1.6, 0.0)), None);
}

#[test]
fn opencv_agrees_with_its_own_numbers() {
    // cv2.projectPoints and cv2.fisheye.projectPoints of OpenCV 5.0.0, K = [800 0 639.5; 0 790 360.25], on (0.3, -0.2, 1.0).
    let at = |m: &CameraModel| m.project(DVec3::new(0.3, -0.2, 1.0)).unwrap();
    let models = all();
    let expected = CV2;
    for (i, (kind, x, y)) in expected.iter().enumerate() {
        let model = models.iter().find(|m| m.kind() == *kind).unwrap_or_else(|| panic!("{i}"));
        let found = at(model);
        assert!((found - DVec2::new(*x, *y)).length() < 1e-9, "{kind:?} {found}");
    }
}

/// Kind and place that OpenCV gives.
const CV2: [(ModelKind, f64, f64); 6] = [
    (ModelKind::OpenCv4, 870.96264, 207.914932),
    (ModelKind::OpenCv5, 870.95631264, 207.91909751199998),
    (ModelKind::OpenCv8, 870.393084121042, 208.28988962031403),
    (ModelKind::OpenCv12, 870.4423801210419, 208.26041472031403),
    (ModelKind::OpenCv14, 870.4499612336151, 208.27124013826375),
    (ModelKind::Fisheye, 869.5789778708781, 208.78133956833858),
];

#[test]
fn the_range_ends_where_the_radius_turns_back() {
    // r (1 + k r²) with k = −0.1 turns at r = √(1 / 0.3).
    let turn = model(ModelKind::SimpleRadial, &[-0.1]).largest_angle().tan();
    assert!((turn - (1.0f64 / 0.3).sqrt()).abs() < 1e-6, "{turn}");
    // θ (1 + k θ²) with k = −0.1 turns at the same angle.
    let turn = model(ModelKind::Fisheye, &[-0.1, 0.0, 0.0, 0.0]).largest_angle();
    assert!((turn - (1.0f64 / 0.3).sqrt()).abs() < 1e-6, "{turn}");
    // Usenko et al. 2018, eq. 51: r² ≤ 1 / (2α − 1).
    let sphere = model(ModelKind::DoubleSphere, &[-0.2, 0.6]);
    let end = sphere.radius(sphere.largest_angle()).0;
    assert!((end * end - 5.0).abs() < 1e-6, "{end}");
    let m = model(ModelKind::SimpleRadial, &[-0.1]);
    assert!(m.project(towards(m.largest_angle() * 1.001, 0.3)).is_none() && m.project(DVec3::NEG_Z).is_none());
    assert!(m.unproject(DVec2::new(1e5, 0.0)).is_none());
}

#[test]
fn a_scaled_picture_shows_the_same() {
    let m = model(ModelKind::OpenCv5, &[-0.28, 0.09, 0.0007, -0.0004, -0.012]);
    let half = m.scaled(DVec2::splat(0.5));
    let direction = towards(0.4, 1.0);
    let (a, b) = (m.project(direction).unwrap(), half.project(direction).unwrap());
    assert!(((a + 0.5) * 0.5 - (b + 0.5)).length() < 1e-10, "{a} {b}");
}

#[test]
fn wrong_numbers_are_refused() {
    let new = |kind, k: &[f64], f: f64| CameraModel::new(kind, DVec2::splat(f), DVec2::ZERO, k.to_vec());
    let e = new(ModelKind::OpenCv5, &[0.0; 4], 1.0).unwrap_err().to_string();
    assert!(e.contains("opencv5 with 4 coefficients: expected 5"), "{e}");
    assert!(new(ModelKind::Pinhole, &[], 0.0).is_err() && new(ModelKind::Division, &[f64::NAN], 1.0).is_err());
    assert_eq!(ModelKind::named("opencv"), Some(ModelKind::OpenCv5));
}
