//! Skeletons against closed forms.

use super::{Description, load};
use crate::motion::{Deformer, Motion, Pose};
use crate::scene::Shape;
use glam::{Mat3, Vec3};

fn read(body: &str) -> Description {
    let text = format!("#usda 1.0\n( metersPerUnit = 1\n timeCodesPerSecond = 10\n startTimeCode = 5 )\n{body}");
    load(text.into(), "t.usda", &|_| Err("no files here".into())).unwrap_or_else(|e| panic!("{e}"))
}

fn bent(d: &Description, object: usize) -> (&Deformer, u32) {
    let Motion::Deformed { deformer } = d.objects[object].motion else { panic!("{:?}: {:?}", d.objects[object], d.warnings) };
    let Shape::Mesh { mesh, .. } = d.objects[object].shape else { panic!("a mesh") };
    (&d.deformers[deformer as usize], mesh)
}

fn pose(d: &Description, object: usize, time_s: f64) -> Pose {
    let (deformer, mesh) = bent(d, object);
    d.timeline().pose(deformer, &d.meshes[mesh as usize], time_s)
}

fn assert_near(found: &[Vec3], expected: &[Vec3], what: &str) {
    assert_eq!(found.len(), expected.len(), "{what}");
    for (a, b) in found.iter().zip(expected) {
        assert!((*a - *b).length() < 2e-5, "{what}: {a}, expected {b}");
    }
}

/// Two joints on the x axis, a unit apart; the outer one turns by 90° about z in one second.
fn arm(mesh: &str, animation: &str) -> String {
    format!(
        "def SkelRoot \"Root\" {{
            double3 xformOp:translate = (10, 0, 0)
            uniform token[] xformOpOrder = [\"xformOp:translate\"]
            rel skel:skeleton = </Root/Bones>
            def Skeleton \"Bones\" {{
                double3 xformOp:translate = (0, 3, 0)
                uniform token[] xformOpOrder = [\"xformOp:translate\"]
                rel skel:animationSource = <Turn>
                uniform token[] joints = [\"a\", \"a/b\"]
                uniform matrix4d[] bindTransforms = [( (1,0,0,0), (0,1,0,0), (0,0,1,0), (0,0,0,1) ), ( (1,0,0,0), (0,1,0,0), (0,0,1,0), (1,0,0,1) )]
                uniform matrix4d[] restTransforms = [( (1,0,0,0), (0,1,0,0), (0,0,1,0), (0,0,0,1) ), ( (1,0,0,0), (0,1,0,0), (0,0,1,0), (1,0,0,1) )]
                def SkelAnimation \"Turn\" {{ {animation} }}
            }}
            def Mesh \"Skin\" {{
                double3 xformOp:translate = (0, 0, 77)
                uniform token[] xformOpOrder = [\"xformOp:translate\"]
                {mesh}
            }}
        }}"
    )
}

const TURN: &str = "uniform token[] joints = [\"a/b\"]
    float3[] translations = [(1, 0, 0)]
    half3[] scales = [(1, 1, 1)]
    quatf[] rotations.timeSamples = { 5: [(1, 0, 0, 0)], 15: [(0.70710678, 0, 0, 0.70710678)] }";

const TRIANGLE: &str = "int[] faceVertexCounts = [3]\nint[] faceVertexIndices = [0, 1, 2]\nuniform token subdivisionScheme = \"none\"
    point3f[] points = [(0, 0, 0), (2, 0, 0), (1.5, 1, 0)]\nnormal3f[] normals = [(0, 1, 0), (0, 1, 0), (0, 1, 0)] ( interpolation = \"vertex\" )\n";

#[test]
fn skins_stand_where_their_joints_are() {
    // Listed the other way round by the mesh; bound half a unit higher than it was modelled.
    let skin = format!(
        "{TRIANGLE} uniform token[] skel:joints = [\"a/b\", \"a\"]
        matrix4d primvars:skel:geomBindTransform = ( (1,0,0,0), (0,1,0,0), (0,0,1,0), (0,0.5,0,1) )
        int[] primvars:skel:jointIndices = [1, 0, 0, 1, 0, 1] ( interpolation = \"vertex\" elementSize = 2 )
        float[] primvars:skel:jointWeights = [2, 0, 1, 0, 0.25, 0.75] ( interpolation = \"vertex\" elementSize = 2 )"
    );
    let d = read(&arm(&skin, TURN));
    assert!(d.warnings.is_empty(), "{:?}", d.warnings);
    assert!(d.timeline().bends(bent(&d, 0).0));
    for (time_s, angle_deg) in [(0.0f64, 0.0f32), (0.5, 45.0), (1.0, 90.0), (9.0, 90.0)] {
        let turn = Mat3::from_rotation_z(angle_deg.to_radians());
        // Where the skeleton is, not where the mesh is.
        let root = Vec3::new(10.0, 3.0, 0.0);
        let by_b = |p: Vec3| Vec3::X + turn * (p - Vec3::X);
        let [p, q, r] = [[0.0, 0.5], [2.0, 0.5], [1.5, 1.5]].map(|[x, y]| Vec3::new(x, y, 0.0));
        let expected = [p, by_b(q), 0.25 * by_b(r) + 0.75 * r].map(|p| root + p);
        let pose = pose(&d, 0, time_s);
        assert_near(&pose.positions, &expected, &format!("{time_s} s"));
        assert_near(&pose.normals[..2], &[Vec3::Y, turn * Vec3::Y], &format!("normals at {time_s} s"));
    }
    // As rays meet it: within the shutter it is elsewhere than before.
    crate::Scene::build(d).unwrap();
}

#[test]
fn joints_without_an_animation_stand_as_at_rest() {
    let skin = format!(
        "{TRIANGLE} int[] primvars:skel:jointIndices = [1] ( interpolation = \"constant\" )
        float[] primvars:skel:jointWeights = [1] ( interpolation = \"constant\" )"
    );
    // A rest pose that is not the bind pose.
    let text = arm(&skin, "").replace(
        "restTransforms = [( (1,0,0,0), (0,1,0,0), (0,0,1,0), (0,0,0,1) )",
        "restTransforms = [( (1,0,0,0), (0,1,0,0), (0,0,1,0), (0,0,-4,1) )",
    );
    let d = read(&text);
    let expected = [[0.0, 0.0], [2.0, 0.0], [1.5, 1.0]].map(|[x, y]| Vec3::new(10.0 + x, 3.0 + y, -4.0));
    assert_near(&pose(&d, 0, 0.3).positions, &expected, "rest");
    assert!(!d.timeline().bends(bent(&d, 0).0));
    // Without rest transforms the bind pose is shown.
    let d = read(&text.replace("restTransforms", "otherTransforms"));
    assert_near(&pose(&d, 0, 0.3).positions, &expected.map(|p| p + Vec3::Z * 4.0), "bind");
}

#[test]
fn blend_shapes_are_added_before_the_skin() {
    let shapes = format!(
        "{TRIANGLE} uniform token[] skel:blendShapes = [\"up\", \"unused\", \"all\"]
        rel skel:blendShapeTargets = [<up>, <unused>, <all>]
        def BlendShape \"up\" {{ uniform vector3f[] offsets = [(0, 2, 0)]\nuniform int[] pointIndices = [1]\nuniform vector3f[] normalOffsets = [(1, 0, 0)] }}
        def BlendShape \"unused\" {{ uniform vector3f[] offsets = [(9, 9, 9), (9, 9, 9), (9, 9, 9)] }}
        def BlendShape \"all\" {{ uniform vector3f[] offsets = [(0, 0, 1), (0, 0, 1), (0, 0, 2)] }}"
    );
    let weights = "uniform token[] blendShapes = [\"all\", \"up\"]
        float[] blendShapeWeights.timeSamples = { 5: [0, 0.5], 15: [1, 1] }";
    let skin = "int[] primvars:skel:jointIndices = [0, 1, 0] ( interpolation = \"vertex\" )
        float[] primvars:skel:jointWeights = [1, 1, 1] ( interpolation = \"vertex\" )";
    // Held by joints, it is where they are; held by none, where it was modelled.
    let no_joints =
        arm(&shapes, weights).replace("uniform token[] joints", "uniform token[] others").replace("bindTransforms", "others2");
    assert_near(&pose(&read(&no_joints), 0, 1.0).positions[1..2], &[Vec3::new(12.0, 2.0, 78.0)], "without joints");
    for (skin, animation) in [(String::new(), weights.to_owned()), (skin.to_owned(), format!("{TURN}\n{weights}"))] {
        let d = read(&arm(&format!("{shapes}\n{skin}"), &animation));
        assert!(d.warnings.is_empty(), "{:?}", d.warnings);
        for time_s in [0.0, 0.25, 1.0] {
            let t = time_s as f32;
            let (all, up) = (t, 0.5 + 0.5 * t);
            let [p, q, r] = [Vec3::Z * all, Vec3::new(2.0, 2.0 * up, all), Vec3::new(1.5, 1.0, 2.0 * all)];
            let turn = Mat3::from_rotation_z(t * 90f32.to_radians());
            let root = Vec3::X * 10.0;
            let expected = match skin.is_empty() {
                true => [p, q, r].map(|p| root + Vec3::Z * 77.0 + p),
                false => [p, Vec3::X + turn * (q - Vec3::X), r].map(|p| root + Vec3::Y * 3.0 + p),
            };
            let pose = pose(&d, 0, time_s);
            assert_near(&pose.positions, &expected, &format!("{time_s} s, skin {skin:?}"));
            let normal = Vec3::new(up, 1.0, 0.0).normalize();
            let normal = if skin.is_empty() { normal } else { turn * normal };
            assert_near(&pose.normals[1..2], &[normal], "normals");
        }
    }
}

#[test]
fn in_between_shapes_are_passed_on_the_way() {
    // The expected weights are those of usd-core 26.11, `UsdSkel.BlendShapeQuery.ComputeSubShapeWeights`.
    let shapes = format!(
        "{TRIANGLE} uniform token[] skel:blendShapes = [\"s\"]
        rel skel:blendShapeTargets = <S>
        def BlendShape \"S\" {{
            uniform vector3f[] offsets = [(1, 0, 0)]\nuniform int[] pointIndices = [1]
            uniform vector3f[] normalOffsets = [(1, 0, 0)]
            uniform vector3f[] inbetweens:b = [(0, 0, 1)] ( weight = 0.75 )
            uniform vector3f[] inbetweens:a = [(0, 1, 0)] ( weight = 0.25 )
            uniform vector3f[] inbetweens:a:normalOffsets = [(0, 0, 2)]
            uniform vector3f[] inbetweens:n = [(0, 0, 9)] ( weight = -0.5 )
        }}"
    );
    let weights = "uniform token[] blendShapes = [\"s\"]
        float[] blendShapeWeights.timeSamples = { 5: [-2], 15: [3] }";
    let d = read(&arm(&shapes, weights));
    assert!(d.warnings.is_empty(), "{:?}", d.warnings);
    let (one, a, b, n) = (Vec3::X, Vec3::Y, Vec3::Z, Vec3::Z * 9.0);
    for (weight, offset) in [
        (-2.0, n * 4.0),
        (-1.0, n * 2.0),
        (-0.3, n * 0.6),
        (0.0, Vec3::ZERO),
        (0.1, a * 0.4),
        (0.25, a),
        (0.3, a * 0.9 + b * 0.1),
        (0.75, b),
        (0.9, b * 0.4 + one * 0.6),
        (1.0, one),
        (2.0, one * 5.0 - b * 4.0),
    ] {
        let pose = pose(&d, 0, (weight + 2.0) / 5.0);
        let expected = Vec3::new(12.0, 0.0, 77.0) + offset;
        assert!((pose.positions[1] - expected).length() < 1e-4, "{weight}: {} {expected}", pose.positions[1]);
        if weight == 0.1 {
            assert_near(&pose.normals[1..2], &[Vec3::new(0.0, 1.0, 0.8).normalize()], "normals");
        }
    }
    // Not over time: the weight at the start alone.
    let d = read(&arm(&shapes, "uniform token[] blendShapes = [\"s\"]\nfloat[] blendShapeWeights = [0.5]"));
    assert_near(&pose(&d, 0, 0.0).positions[1..2], &[Vec3::new(12.0, 0.5, 77.5)], "0.5");
    // Where the weight is missing, or that of the shape itself, the others are used.
    for wrong in ["", "( weight = 1 )", "( weight = 0 )", "( weight = 0.25 )"] {
        let d = read(&arm(&shapes.replace("( weight = 0.75 )", wrong), weights));
        assert!(d.warnings.iter().any(|w| w.contains("without a weight of their own")), "{wrong}: {:?}", d.warnings);
        let height = pose(&d, 0, 2.5 / 5.0).positions[1] - Vec3::new(12.0, 0.0, 77.0);
        assert!((height - (a * 2.0 / 3.0 + one / 3.0)).length() < 1e-4, "{wrong}: {height}");
    }
    let d = read(&arm(&shapes.replace("[(0, 0, 1)] ( weight", "[(0, 0, 1), (0, 0, 1)] ( weight"), weights));
    assert!(d.warnings.iter().any(|w| w.contains("in-between shapes that do not fit")), "{:?}", d.warnings);
}

#[test]
fn subdivided_skins_bend_as_their_control_meshes_do() {
    let quads = "int[] faceVertexCounts = [4, 4]\nint[] faceVertexIndices = [0, 1, 4, 3, 1, 2, 5, 4]
        point3f[] points = [(0, 0, 0), (1, 0, 0), (2, 0, 0), (0, 1, 0), (1, 1, 0), (2, 1, 0)]
        uniform token[] skel:blendShapes = [\"fold\"]\nrel skel:blendShapeTargets = <fold>
        def BlendShape \"fold\" { uniform vector3f[] offsets = [(0, 0, 1), (0, 0, 1)]\nuniform int[] pointIndices = [2, 5] }\n";
    let one = format!(
        "{quads} int[] primvars:skel:jointIndices = [1] ( interpolation = \"constant\" )
        float[] primvars:skel:jointWeights = [1] ( interpolation = \"constant\" )"
    );
    let two = format!(
        "{quads} int[] primvars:skel:jointIndices = [0, 1, 1, 0, 1, 1] ( interpolation = \"vertex\" )
        float[] primvars:skel:jointWeights = [1, 1, 1, 1, 1, 1] ( interpolation = \"vertex\" )"
    );
    let folded = "uniform token[] blendShapes = [\"fold\"]\nfloat[] blendShapeWeights = [0.5]";
    for (skin, rigid) in [(one, true), (two, false)] {
        let d = read(&arm(&skin, &format!("{TURN}\n{folded}")));
        let (deformer, mesh) = bent(&d, 0);
        let mesh = &d.meshes[mesh as usize];
        assert_eq!((mesh.triangles.len(), deformer.targets.len()), (64, 1));
        // The shape subdivided as OpenUSD does it: with its points where the shape moves them.
        let moved = quads.replace("(2, 0, 0)", "(2, 0, 0.5)").replace("(2, 1, 0)", "(2, 1, 0.5)");
        let moved = read(&format!("def Mesh \"M\" {{ {} }}", moved.split("uniform token[] skel").next().unwrap()));
        let fine = &moved.meshes[0];
        let turn = Mat3::from_rotation_z(90f32.to_radians());
        let pose = pose(&d, 0, 1.0);
        let root = Vec3::new(10.0, 3.0, 0.0);
        let by_b = |p: Vec3| root + Vec3::X + turn * (p - Vec3::X);
        let skin = deformer.skin.as_ref().unwrap();
        for (i, p) in fine.positions.iter().enumerate() {
            let influences = &skin.influences[i * skin.per_corner..][..skin.per_corner];
            let weight_b: f32 = influences.iter().filter(|i| i.0 == 1).map(|i| i.1).sum();
            let sum: f32 = influences.iter().map(|i| i.1).sum();
            assert!((sum - 1.0).abs() < 1e-5 && (0.0..=1.0 + 1e-5).contains(&weight_b), "{influences:?}");
            let expected = weight_b * by_b(*p) + (1.0 - weight_b) * (root + *p);
            assert!((pose.positions[i] - expected).length() < 1e-4, "{i}: {} {expected}", pose.positions[i]);
            match rigid {
                true => {
                    assert_eq!(weight_b, 1.0);
                    let normal = turn * fine.normals[i];
                    // Of triangles here, of the limit there.
                    assert!(pose.normals[i].dot(normal) > 0.99, "{i}: {} {normal}", pose.normals[i]);
                }
                // A cubic B-spline of the weights 0, 1, 1, continued as it ends.
                false => {
                    let t = p.x.fract();
                    let expected = match p.x {
                        x if x >= 2.0 => 1.0,
                        x if x >= 1.0 => 1.0 - (1.0 - t).powi(3) / 6.0,
                        _ => (1.0 + 3.0 * t + 3.0 * t * t - 2.0 * t.powi(3) - (1.0 - t).powi(3)) / 6.0,
                    };
                    assert!((weight_b - expected).abs() < 1e-5, "{p}: {weight_b} {expected}");
                }
            }
        }
    }
}

#[test]
fn what_does_not_fit_is_shown_as_it_was_modelled() {
    let skin = |indices: &str, weights: &str| {
        format!(
            "{TRIANGLE} int[] primvars:skel:jointIndices = {indices} ( interpolation = \"vertex\" )
            float[] primvars:skel:jointWeights = {weights} ( interpolation = \"vertex\" )"
        )
    };
    let good = skin("[0, 1, 0]", "[1, 1, 1]");
    for (text, warning) in [
        (arm(&skin("[0, 1, 0]", "[1, 1]"), TURN), "do not fit their mesh"),
        (arm(&skin("[0, 1]", "[1, 1]"), TURN), "do not fit their mesh"),
        (arm(&skin("[0, 2, 0]", "[1, 1, 1]"), TURN), "joints that their skeleton does not have"),
        (arm(&good, TURN).replace("skel:skeleton = </Root/Bones>", "skel:skeleton = </Root/Gone>"), "skeleton is not there"),
        (arm(&good, TURN).replace("SkelRoot", "Xform"), "outside of a SkelRoot"),
        (arm(&good, TURN).replace("bindTransforms = [( (1", "bindTransforms = [( (0"), "without a bind transform"),
    ] {
        let d = read(&text);
        assert!(d.warnings.iter().any(|w| w.contains(warning)), "{warning}: {:?}", d.warnings);
        assert_eq!(d.objects[0].motion, Motion::Still, "{warning}");
        let Shape::Mesh { world_from_mesh, .. } = d.objects[0].shape else { panic!("a mesh") };
        assert_eq!(world_from_mesh.transform_point3(Vec3::ZERO), Vec3::new(10.0, 0.0, 77.0));
    }
    // Numbers of an animation for other joints than it names: the pose is that at rest.
    let d = read(&arm(&good, &TURN.replace("[\"a/b\"]", "[\"a/b\", \"a\"]")));
    assert!(d.warnings.iter().any(|w| w.contains("do not fit their joints")), "{:?}", d.warnings);
    assert_near(&pose(&d, 0, 1.0).positions[1..2], &[Vec3::new(12.0, 3.0, 0.0)], "rest");
}
