use super::*;

fn channel(property: AnimatedProperty, interpolation: KeyInterpolation, times: &[f32], values: &[f32]) -> Channel {
    Channel { node: 0, property, interpolation, times_s: times.to_vec(), values: values.to_vec() }
}

#[test]
fn keys_are_interpolated_as_gltf_says() {
    use AnimatedProperty::*;
    use KeyInterpolation::*;
    let values = [0.0, 0.0, 0.0, 4.0, 0.0, 0.0];
    let linear = channel(Translation, Linear, &[1.0, 3.0], &values);
    assert_eq!(linear.at(2.0), vec![2.0, 0.0, 0.0]);
    assert_eq!((linear.at(0.0)[0], linear.at(9.0)[0]), (0.0, 4.0));
    assert_eq!(channel(Translation, Step, &[1.0, 3.0], &values).at(2.9), vec![0.0; 3]);
    // A cubic whose tangents are 2 m/s both ends: the straight line.
    let v = [0., 0., 0., 0., 0., 0., 2., 0., 0., 2., 0., 0., 4., 0., 0., 0., 0., 0.];
    let cubic = channel(Translation, Cubic, &[1.0, 3.0], &v);
    for t in [1.0, 1.3, 2.0, 2.9] {
        assert!((cubic.at(t)[0] - 2.0 * (t as f32 - 1.0)).abs() < 1e-6, "{t}");
    }
    // Half of a quarter turn is an eighth of a turn, the short way even if the keys' signs differ.
    let quarter = Quat::from_rotation_z(std::f32::consts::FRAC_PI_2);
    let keys = [Quat::IDENTITY.to_array(), (-quarter).to_array()].concat();
    let turn = Quat::from_slice(&channel(Rotation, Linear, &[0.0, 1.0], &keys).at(0.5));
    assert!(turn.angle_between(Quat::from_rotation_z(std::f32::consts::FRAC_PI_4)) < 1e-3);
}

#[test]
fn odd_keys_are_mended_or_refused() {
    use AnimatedProperty::Translation;
    use KeyInterpolation::Linear;
    let mut unsorted = channel(Translation, Linear, &[2.0, 0.0], &[2.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    assert!(unsorted.check().unwrap().unwrap().contains("sorted"));
    assert_eq!(unsorted.at(1.0)[0], 1.0);
    // Two keys at one moment are a jump.
    let mut jump = channel(Translation, Linear, &[0.0, 1.0, 1.0, 2.0], &[0., 0., 0., 1., 0., 0., 5., 0., 0., 6., 0., 0.]);
    assert_eq!(jump.check(), Ok(None));
    assert!((jump.at(0.999)[0] - 0.999).abs() < 1e-6 && (jump.at(1.0)[0] - 5.0).abs() < 1e-6);
    for (times, values) in
        [(vec![], vec![]), (vec![f32::NAN], vec![0.0; 3]), (vec![0.0], vec![0.0; 4]), (vec![-1.0], vec![0.0; 3])]
    {
        assert!(channel(Translation, Linear, &times, &values).check().is_err(), "{times:?}");
    }
}

#[test]
fn animations_end_as_asked() {
    let nodes = [Node::new("a")];
    let c = channel(AnimatedProperty::Translation, KeyInterpolation::Linear, &[0.0, 2.0], &[0., 0., 0., 2., 0., 0.]);
    let animations = [Animation { name: "x".into(), channels: vec![c] }];
    let at = |ending, frozen_at_s, t| {
        let playing = AnimationPlayback { animations: vec![0], ending, frozen_at_s };
        Timeline::new(&nodes, &animations, &playing).world(0, t).translation.x
    };
    assert_eq!(at(Extrapolation::Clamp, None, 5.0), 2.0);
    assert!((at(Extrapolation::Loop, None, 5.0) - 1.0).abs() < 1e-6);
    assert_eq!(at(Extrapolation::Loop, Some(0.5), 5.0), 0.5);
    let playing = AnimationPlayback { animations: vec![0], ending: Extrapolation::Loop, frozen_at_s: None };
    let kinks = Timeline::new(&nodes, &animations, &playing).kinks([0], 3.0, 7.0, 100);
    assert!(kinks.contains(&4.0) && kinks.contains(&6.0) && kinks.len() <= 4, "{kinks:?}");
}

#[test]
fn corners_follow_their_joints_and_targets() {
    let mut nodes = vec![Node::new("a"), Node::new("b")];
    nodes[1].rest = Local::Parts(Parts { translation: Vec3::X * 2.0, ..Parts::IDENTITY });
    let mesh = Mesh { positions: vec![Vec3::ZERO, Vec3::Y], normals: vec![Vec3::Z; 2], ..Default::default() };
    let skin = Skin {
        joints: vec![0, 1],
        joint_from_mesh: vec![],
        influences: vec![(0, 0.5), (1, 0.5), (1, 1.0), (0, 0.0)],
        per_corner: 2,
    };
    let target = Target { positions: vec![Vec3::Z, Vec3::ZERO], ..Default::default() };
    let deformer = Deformer { mesh: 0, node: 0, targets: vec![target], weights: vec![0.5], skin: Some(skin) };
    let playing = AnimationPlayback::default();
    let pose = Timeline::new(&nodes, &[], &playing).pose(&deformer, &mesh, 0.0);
    assert_eq!(pose.positions, vec![Vec3::new(1.0, 0.0, 0.5), Vec3::new(2.0, 1.0, 0.0)]);
    assert_eq!(pose.normals, vec![Vec3::Z; 2]);
}
