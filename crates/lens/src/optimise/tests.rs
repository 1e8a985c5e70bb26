use super::*;
use crate::embedded;
use crate::prescription::read_toml;
use crate::tolerance::Direction;

fn optimisation(lens: &Prescription, sheet: &str) -> Optimisation {
    Optimisation::new(lens, &MeritSheet::parse(sheet, "merit.toml").unwrap()).unwrap()
}

const GAUSS: &str = "entrance_pupil = 12.5\nfields_deg = [0, 10]\nwavelengths_nm = [587.56]\n\
    [[variable]]\nsurfaces = \"all\"\nwhat = \"curvature\"\n[[variable]]\nsurfaces = 11\nwhat = \"gap\"\n\
    [[operand]]\nkind = \"spot\"\n[[operand]]\nkind = \"efl\"\ntarget = 50\nweight = 1000\n\
    [[operand]]\nkind = \"edge\"\nat_least = 0.1\nweight = 1e4\n";

#[test]
fn a_singlet_bends_to_the_least_spherical_aberration() {
    // Thin lens, object at infinity: q = 2 (n² − 1)/(n + 2) with q = (c1 + c2)/(c1 − c2) (Jenkins & White, "Fundamentals of
    // Optics", §9.5, their p = −1); f/50 and a thickness of f/5000 leave third order of a thin lens.
    let singlet = read_toml(
        "name = \"singlet\"\nsurfaces = [ { radius = 1000, gap = 0.2, glass = \"1.5\", semi_diameter = 10, stop = true },\n\
         { radius = -1000, gap = 1000, semi_diameter = 10.1 } ]",
        "singlet.toml",
    )
    .unwrap();
    let o = optimisation(
        &singlet,
        "fields_deg = [0]\nwavelengths_nm = [587.56]\n[[variable]]\nsurfaces = \"all\"\nwhat = \"curvature\"\n[[variable]]\n\
         surfaces = 2\nwhat = \"gap\"\nmin = 900\nmax = 1100\n[[operand]]\nkind = \"spot\"\nweight = 100\n\
         [[operand]]\nkind = \"efl\"\ntarget = 1000",
    );
    let report = o.run(0, 500).unwrap();
    let [c1, c2] = [0, 1].map(|i| report.lens.surfaces[i].profile.curvature());
    let (q, expected) = ((c1 + c2) / (c1 - c2), 2.0 * (1.5f64 * 1.5 - 1.0) / 3.5);
    assert!((q / expected - 1.0).abs() < 0.01, "{q} {expected} {report:?}");
    assert!(report.merits[1] < report.merits[0] && report.lens.notes.iter().any(|n| n.contains("optimised from")));
}

#[test]
fn exact_derivatives_are_those_of_small_differences() {
    let all = "[[variable]]\nsurfaces = [1, 11]\nwhat = \"asphere 4\"\n[[variable]]\nsurfaces = [3, 5, 11]\nwhat = \"gap\"\n\
        [[variable]]\nsurfaces = [1, 8]\nwhat = \"index\"\n[[variable]]\nsurfaces = [2, 9]\nwhat = \"conic\"\n\
        [[variable]]\nsurfaces = [4]\nwhat = \"asphere 2\"\n";
    let operands = "[[operand]]\nkind = \"spot\"\n[[operand]]\nkind = \"spot\"\nat_most = 1\n[[operand]]\nkind = \"wavefront\"\n\
        [[operand]]\nkind = \"wavefront\"\nat_most = 0.01\n[[operand]]\nkind = \"mtf\"\nfrequency = 30\n\
        [[operand]]\nkind = \"distortion\"\ntarget = 0\n[[operand]]\nkind = \"chief_angle\"\ntarget = 3\n\
        [[operand]]\nkind = \"efl\"\ntarget = 48\n[[operand]]\nkind = \"efl\"\nat_most = 40\n[[operand]]\nkind = \"bfl\"\ntarget = 30\n\
        [[operand]]\nkind = \"length\"\ntarget = 50\n[[operand]]\nkind = \"thickness\"\nsurfaces = 3\nat_least = 20\n\
        [[operand]]\nkind = \"edge\"\nsurfaces = [2, 4, 9]\nat_least = 20\n";
    let curvatures = "[[variable]]\nsurfaces = \"all\"\nwhat = \"curvature\"\n";
    let beams = "entrance_pupil = 12.5\nfields_deg = [0, 10]\nwavelengths_nm = [486.1, 587.56]\n";
    // The stop of the double Gauss is a plane: neither conic nor curvature of it is asked for.
    let gauss = embedded("double-gauss-50mm").unwrap();
    let mut near = gauss.clone();
    near.usage.object_distance = Some(400.0);
    let anamorph = embedded("anamorphic-31mm").unwrap();
    let of_anamorph = "entrance_pupil = 8\nfields_deg = [0, 5]\nwavelengths_nm = [587.56]\n[[variable]]\nsurfaces = [8, 12]\nwhat = \"curvature\"\n\
        [[variable]]\nsurfaces = [2, 10]\nwhat = \"gap\"\n";
    let sheets = [
        (&gauss, format!("{beams}{curvatures}{all}{operands}")),
        (&near, format!("{beams}{curvatures}{all}{operands}")),
        (&anamorph, format!("{of_anamorph}{}", &operands[..operands.find("[[operand]]\nkind = \"thickness").unwrap()])),
    ];
    // Cylinders that stand across the plane of the field: differences.
    let cylinders =
        optimisation(&anamorph, &format!("{}[[operand]]\nkind = \"spot\"\n", of_anamorph.replace("[8, 12]", "[1, 2]")));
    assert!(cylinders.exact_derivatives(&cylinders.start_values()).is_none());
    for (lens, sheet) in &sheets {
        let o = optimisation(lens, sheet);
        let x = o.start_values();
        let here = o.at(&x).unwrap();
        let exact = o.exact_derivatives(&x).unwrap();
        let over = |width: f64| {
            let wide = Optimisation { steps: o.steps.iter().map(|s| width * s).collect(), ..o.clone() };
            levenberg::differences(&wide, &x, &here)
        };
        let (fine, coarse) = (over(1.0), over(2.0));
        // An operand is held against the largest of its own kind of residuals: their units differ.
        for (i, column) in exact.iter().enumerate() {
            let mut from = 0;
            for (operand, (_, residuals)) in o.operands.iter().zip(o.evaluate(lens).unwrap()) {
                let range = from..from + residuals.len();
                from = range.end;
                // Paths are rounded to 1e-13 mm: 2e-10 waves.
                let unit = if operand.kind == OperandKind::Wavefront { 1e-9 } else { 1e-12 };
                let largest = fine[i][range.clone()].iter().fold(0.0f64, |a, v| a.max(v.abs()));
                let scale = here[range.clone()].iter().fold(0.0f64, |a, v| a.max(v.abs()));
                for k in range {
                    // Richardson's step; what the rounding of a residual leaves over the width of the step cannot be seen.
                    let expected = (4.0 * fine[i][k] - coarse[i][k]) / 3.0;
                    let rounding = unit * (scale + 1.0) / o.steps[i];
                    let apart = (column[k] - expected).abs();
                    let name = (o.variables[i].name(), operand.name(&o.fields_deg));
                    assert!(apart < 1e-6 * largest + rounding, "{} {name:?}: {} {expected} of {largest}", lens.name, column[k]);
                }
            }
            assert_eq!(from, column.len());
            assert!(column.iter().any(|v| *v != 0.0), "{} changes nothing", o.variables[i].name());
        }
    }
}

#[test]
fn a_perturbed_double_gauss_comes_back() {
    let lens = embedded("double-gauss-50mm").unwrap();
    let best = optimisation(&lens, GAUSS).run(0, 120).unwrap();
    assert!(best.merits[1] < best.merits[0], "{best:?}");
    let mut moved = best.lens.clone();
    for (i, s) in moved.surfaces.iter_mut().enumerate() {
        let sign = if i % 3 == 0 { 1.0 } else { -1.0 };
        s.profile = crate::tolerance::bend(&s.profile, |c| c * (1.0 + 0.004 * sign));
    }
    let again = optimisation(&moved, GAUSS).run(0, 200).unwrap();
    assert!(again.merits[0] > 1.5 * best.merits[1], "the perturbation costs something: {:?}", again.merits);
    assert!(again.merits[1] < 1.01 * best.merits[1], "{:?} {:?}", again.merits, best.merits);
}

#[test]
fn plane_plates_become_a_triplet_sharper_than_a_published_one() {
    let published = embedded("triplet-50mm-f4").unwrap();
    let mut plates = published.clone();
    (plates.focal_length, plates.f_number, plates.image_circle) = (None, None, None);
    for s in &mut plates.surfaces {
        s.profile = Profile::Plane;
        s.semi_diameter = s.semi_diameter.map(|r| r.max(6.0));
    }
    let sheet = "entrance_pupil = 12.5\nvignetting = [0, 0.03, 0.06]\nfields_deg = [0, 14, 20]\nwavelengths_nm = [486.1, 587.6, 656.3]\n\
        [[variable]]\nsurfaces = \"all\"\nwhat = \"curvature\"\nmin = -0.07\nmax = 0.07\n\
        [[variable]]\nsurfaces = [1, 2, 3, 4, 5]\nwhat = \"gap\"\nmin = 0.9\nmax = 8\n\
        [[variable]]\nsurfaces = 6\nwhat = \"gap\"\nmin = 30\nmax = 55\n[[operand]]\nkind = \"spot\"\n\
        [[operand]]\nkind = \"efl\"\ntarget = 50\nweight = 1000\n[[operand]]\nkind = \"edge\"\nat_least = 0.5\nweight = 1e4\n";
    let started = std::time::Instant::now();
    let found = optimisation(&plates, sheet).run(200, 500).unwrap();
    println!("{:.1} s, merits {:?}", started.elapsed().as_secs_f64(), found.merits);
    let spot = |p: &Prescription, field: f64, nm: f64| {
        let set = configure(p, None, Some(4.0), None, FilmPlace::AsPublished).unwrap();
        Bench::at_infinity(&set.system).spot(field, nm, 587.6, 40, 0.0).unwrap().rms
    };
    for (field, nm) in [0.0, 14.0, 20.0].into_iter().flat_map(|f| [486.1, 587.6, 656.3].map(|nm| (f, nm))) {
        let [ours, theirs] = [spot(&found.lens, field, nm), spot(&published, field, nm)];
        println!("{field}° {nm} nm: {:.2} µm, published {:.2} µm", ours * 1e3, theirs * 1e3);
        assert!(ours < 1.1 * theirs, "{field} {nm}: {ours} {theirs}");
    }
}

#[test]
fn the_contrast_of_the_merit_is_that_of_the_bench() {
    let lens = embedded("double-gauss-50mm").unwrap();
    for (aperture, tolerance) in [(8.0, 0.03), (4.0, 0.06)] {
        let sheet = format!(
            "aperture = {aperture}\nfields_deg = [0, 10]\nwavelengths_nm = [587.56]\n[[variable]]\nsurfaces = 11\nwhat = \"gap\"\n\
             [[operand]]\nkind = \"mtf\"\nfrequency = 30\n"
        );
        let o = optimisation(&lens, &sheet);
        let found = o.evaluate(&o.start).unwrap();
        let set = configure(&lens, None, Some(aperture), None, FilmPlace::AsPublished).unwrap();
        let bench = Bench::at_infinity(&set.system);
        for (operand, (value, _)) in o.operands.iter().zip(found) {
            let field = o.fields_deg[operand.field.unwrap()];
            let mtf = bench.diffraction_mtf(field, &[(587.56, 1.0)], &[30.0], 0.0).unwrap();
            let expected = match operand.detail.unwrap().1 {
                Direction::Tangential => mtf.tangential[0],
                Direction::Sagittal => mtf.sagittal[0],
            };
            println!("{}: {value:.4}, bench {expected:.4}", operand.name(&o.fields_deg));
            assert!((value - expected).abs() < tolerance, "f/{aperture} {}: {value} {expected}", operand.name(&o.fields_deg));
        }
    }
}

#[test]
fn bounds_and_constraints_hold() {
    let lens = embedded("double-gauss-50mm").unwrap();
    let sheet = "aperture = 4\nfields_deg = [0, 10]\nwavelengths_nm = [587.56]\n\
        [[variable]]\nsurfaces = 1\nwhat = \"curvature\"\nmin = 0.0335\nmax = 0.0342\n\
        [[variable]]\nsurfaces = [2, 11]\nwhat = \"gap\"\n[[operand]]\nkind = \"spot\"\n\
        [[operand]]\nkind = \"thickness\"\nsurfaces = 2\nat_least = 0.5\nweight = 1e8\n";
    let report = optimisation(&lens, sheet).run(0, 60).unwrap();
    let c = report.lens.surfaces[0].profile.curvature();
    assert!((0.0335 - 1e-12..=0.0342 + 1e-12).contains(&c), "{c}");
    // A penalty of 1e8 µm² a mm² leaves micrometres.
    assert!(report.lens.surfaces[1].gap.at(0.0, 0.0) > 0.49, "{:?}", report.lens.surfaces[1].gap);
    let gap = report.operands.iter().find(|o| o.name.starts_with("thickness")).unwrap();
    assert!(gap.values[0] < 0.2 && gap.merits[1] < 1e-2 * gap.merits[0], "{gap:?}");
}

#[test]
fn wrong_merit_files_are_told_what_is_wrong() {
    let lens = embedded("double-gauss-50mm").unwrap();
    let error = |text: &str| match MeritSheet::parse(text, "m.toml") {
        Err(e) => e.to_string(),
        Ok(sheet) => Optimisation::new(&lens, &sheet).err().map(|e| e.to_string()).unwrap_or_default(),
    };
    let curvature = "[[variable]]\nsurfaces = 1\nwhat = \"curvature\"\n";
    for (text, parts) in [
        (String::new(), vec!["m.toml", "0 variables", "expected at least one [[variable]]"]),
        (format!("{curvature}[[operand]]\nkind = \"spt\""), vec!["m.toml:4", "spt", "did you mean \"spot\"?"]),
        (format!("{curvature}[[operand]]\nkind = \"efl\""), vec!["m.toml:4", "efl", "expected target"]),
        (format!("{curvature}min = 1\nmax = 2\n[[operand]]\nkind = \"spot\""), vec!["m.toml:1", "expected a start within"]),
        (format!("{curvature}{curvature}[[operand]]\nkind = \"spot\""), vec!["m.toml:4", "variable already"]),
        (
            "[[variable]]\nsurfaces = 6\nwhat = \"conic\"\n[[operand]]\nkind = \"spot\"".into(),
            vec!["conic of surface 6", "expected a curved surface"],
        ),
        (
            "[[variable]]\nsurfaces = 1\nwhat = \"bend\"\n[[operand]]\nkind = \"spot\"".into(),
            vec!["\"bend\"", "expected curvature, gap"],
        ),
        (
            format!("fields_deg = [0, 10]\n{curvature}[[operand]]\nkind = \"spot\"\nfield_deg = 11"),
            vec!["field_deg 11", "expected one of the fields"],
        ),
        (format!("entrance_pupil = 10\naperture = 4\n{curvature}[[operand]]\nkind = \"spot\""), vec!["expected one of them"]),
        (
            format!("{curvature}[[operand]]\nkind = \"edge\"\nsurfaces = 11\nat_least = 1"),
            vec!["edge after surface 11", "expected a surface before it"],
        ),
    ] {
        let message = error(&text);
        assert!(parts.iter().all(|p| message.contains(p)), "{text}\n{message}");
    }
}
