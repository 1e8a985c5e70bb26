//! Surfaces, phases and configurations of lens files of other programs, on short files written for these tests; and a report over a folder of
//! files from elsewhere.

use diopter_lens::compound::Setting;
use diopter_lens::export::{self, ExportFormat};
use diopter_lens::glass::D_NM;
use diopter_lens::import::{self, Format};
use diopter_lens::paraxial::FirstOrder;
use diopter_lens::surface::Profile;
use diopter_lens::{CompoundLens, Focus, Prescription, State, System};
use std::f64::consts::TAU;
use std::sync::Arc;

fn read(format: Format, text: &str) -> Prescription {
    import::read(text.as_bytes(), format, "test").unwrap_or_else(|e| panic!("{e}\n{text}"))
}

fn error(format: Format, text: &str) -> String {
    import::read(text.as_bytes(), format, "test").map(|p| panic!("accepted: {p:?}")).unwrap_or_else(|e| e.to_string())
}

fn first(p: &Prescription, zoom: f64, nm: f64) -> FirstOrder {
    let s = System::at(p, State { zoom, focus: 0.0 });
    FirstOrder::of(&s, &s.indices(nm))
}

fn zemax(surfaces: &[&str], tail: &str) -> String {
    let mut text = String::from("MODE SEQ\nUNIT MM\nENPD 5\nWAVM 1 0.5876 1\nPWAV 1\nSURF 0\n TYPE STANDARD\n DISZ INFINITY\n");
    for (i, s) in surfaces.iter().enumerate() {
        text += &format!("SURF {}\n{}\n", i + 1, s.replace("; ", "\n"));
    }
    text + &format!("SURF {}\n TYPE STANDARD\n DISZ 0\n{tail}", surfaces.len() + 1)
}

const BACK: &str = " TYPE STANDARD; CURV 0; DISZ 95; DIAM 6";

#[test]
fn zemax_freeforms_have_the_sag_of_their_formulas() {
    let lens = |first: &str, unit: &str| {
        read(
            Format::Zemax,
            &zemax(&[&format!(" STOP; {first}; DISZ 4; GLAS N-BK7 0 0; DIAM 4"), BACK], "").replace("UNIT MM", unit),
        )
    };
    let sag = |p: &Prescription, x: f64, y: f64| p.surfaces[0].profile.sag(x, y).unwrap();
    let conic = |r2: f64, c: f64, k: f64| c * r2 / (1.0 + (1.0 - (1.0 + k) * c * c * r2).sqrt());
    let (x, y) = (1.2, -2.1);
    let (u, v): (f64, f64) = (x / 5.0, y / 5.0);
    let (rho2, angle) = (u * u + v * v, v.atan2(u));
    let base = conic(x * x + y * y, 0.02, -1.0) + 1e-4 * (x * x + y * y).powi(2);
    // Noll: Z4 = √3 (2ρ² − 1), Z6 = √6 ρ² cos 2θ, Z7 = √8 (3ρ³ − 2ρ) sin θ.
    let p = lens(
        "TYPE SZERNSAG; CURV 0.02; CONI -1; PARM 2 1e-4; XDAT 1 7 0 0; XDAT 2 5 0 0; XDAT 6 0.01 0 0; XDAT 8 0.02 0 0; XDAT 9 -0.03 0 0",
        "UNIT MM",
    );
    let expected = base + 0.01 * 3f64.sqrt() * (2.0 * rho2 - 1.0) + 0.02 * 6f64.sqrt() * rho2 * (2.0 * angle).cos()
        - 0.03 * 8f64.sqrt() * (3.0 * rho2 - 2.0) * rho2.sqrt() * angle.sin();
    assert!((sag(&p, x, y) - expected).abs() < 1e-14, "{} {expected}", sag(&p, x, y));
    // Fringe: Z5 = ρ² cos 2θ, Z8 = (3ρ³ − 2ρ) sin θ.
    let p = lens("TYPE FZERNSAG; CURV 0.02; CONI -1; PARM 2 1e-4; XDAT 1 8; XDAT 2 5; XDAT 7 0.02; XDAT 10 -0.03", "UNIT MM");
    let expected = base + 0.02 * rho2 * (2.0 * angle).cos() - 0.03 * (3.0 * rho2 - 2.0) * rho2.sqrt() * angle.sin();
    assert!((sag(&p, x, y) - expected).abs() < 1e-14);
    // x, y, x², xy, y², x³, x²y.
    let p = lens("TYPE XPOLYNOM; CURV 0.02; CONI -1; XDAT 1 7; XDAT 2 5; XDAT 5 0.1; XDAT 6 0.2; XDAT 9 -0.4", "UNIT MM");
    let expected = conic(x * x + y * y, 0.02, -1.0) + 0.1 * u * u + 0.2 * u * v - 0.4 * u * u * v;
    assert!((sag(&p, x, y) - expected).abs() < 1e-14);
    // In centimetres all lengths are ten times as long.
    let ten = lens("TYPE XPOLYNOM; CURV 0.02; CONI -1; XDAT 1 7; XDAT 2 5; XDAT 5 0.1; XDAT 6 0.2; XDAT 9 -0.4", "UNIT CM");
    assert!((sag(&ten, 10.0 * x, 10.0 * y) - 10.0 * expected).abs() < 1e-13);
    let p = lens("TYPE FRESNELS; CURV 0.02; CONI -1; PARM 2 1e-4", "UNIT MM");
    assert!(matches!(&p.surfaces[0].profile, Profile::Fresnel(a) if a.c == 0.02 && a.k == -1.0 && a.a[4] == 1e-4));
    assert!((first(&p, 0.0, D_NM).efl - 1.0 / (0.02 * (p.surfaces[0].glass.index(D_NM) - 1.0))).abs() < 1e-9);
    // Q-con: u⁴ (A₀ + A₁ (6u² − 5)).
    let p = lens("TYPE QED_TYPE; CURV 0.02; CONI -1; XDAT 1 1; XDAT 2 2; XDAT 3 5; XDAT 4 0.02; XDAT 5 0.01", "UNIT MM");
    let expected = conic(x * x + y * y, 0.02, -1.0) + rho2 * rho2 * (0.02 + 0.01 * (6.0 * rho2 - 5.0));
    assert!((sag(&p, x, y) - expected).abs() < 1e-14);
    let wrong =
        |first: &str| error(Format::Zemax, &zemax(&[&format!(" STOP; {first}; DISZ 4; GLAS N-BK7 0 0; DIAM 4"), BACK], ""));
    assert!(wrong("TYPE SZERNSAG; CURV 0.02; PARM 9 0.5; XDAT 1 1; XDAT 2 5; XDAT 3 1").contains("Zernike decentre"));
    assert!(wrong("TYPE SZERNSAG; CURV 0.02; XDAT 1 1; XDAT 3 1").contains("normalisation radius 0"));
    assert!(wrong("TYPE FZERNSAG; CURV 0.02; XDAT 1 99; XDAT 2 5").contains("99 terms"));
    assert!(wrong("TYPE BINARY_3; CURV 0.02").contains("BINARY_1 and BINARY_2"));
}

#[test]
fn phases_of_both_programs_have_the_power_of_their_formulas() {
    // Zemax: M Σ Aᵢ ρ²ⁱ radians; a plane of air: f = −π R² / (M λ A₁).
    let lens = |first: &str| read(Format::Zemax, &zemax(&[&format!(" STOP; {first}; DISZ 4; DIAM 4"), BACK], ""));
    let p = lens("TYPE BINARY_2; CURV 0; PARM 0 2; XDAT 1 2; XDAT 2 5; XDAT 3 -300; XDAT 4 20");
    for nm in [450.0, 587.6] {
        let expected = std::f64::consts::PI * 25.0 / (2.0 * nm * 1e-6 * 300.0);
        assert!((first(&p, 0.0, nm).efl / expected - 1.0).abs() < 1e-12);
    }
    let p = lens("TYPE BINARY_1; CURV 0; PARM 0 1; XDAT 1 5; XDAT 2 5; XDAT 5 -300; XDAT 7 -300");
    assert!((first(&p, 0.0, 500.0).efl / (std::f64::consts::PI * 25.0 / (500e-6 * 300.0)) - 1.0).abs() < 1e-12);
    // Lines a micrometre; order 1 towards −y.
    let p = lens("TYPE DGRATING; CURV 0; PARM 1 0.2; PARM 2 1");
    let phase = p.surfaces[0].diffractive.as_ref().unwrap();
    assert_eq!(phase.phase().terms().xy[&(0, 1)], -TAU * 200.0);
    assert!(
        error(Format::Zemax, &zemax(&[" STOP; TYPE DGRATING; PARM 1 0.2; PARM 2 0.5; DISZ 4; DIAM 4", BACK], ""))
            .contains("order 0.5")
    );
    // CODE V: path in lens units at HWL; f = −1 / (2 C₁) there.
    let text = "RDM; EPD 5; WL 587.6; SO 0 1e14; S 1e20 4 AIR; STO; CIR 4; DIF DOE; HOR 1; HWL 550; HCT R; HCO C1 -0.002; HCC C1 100; S 1e20 200; CIR 9; SI 0 0; GO";
    let p = read(Format::CodeV, text);
    assert!((first(&p, 0.0, 550.0).efl - 250.0).abs() < 1e-9 && (first(&p, 0.0, 500.0).efl - 275.0).abs() < 1e-9);
    assert!(error(Format::CodeV, &text.replace("HWL 550; ", "")).contains("without HWL"));
    assert!(error(Format::CodeV, &text.replace("DIF DOE", "DIF GRT")).contains("DIF GRT"));
    // In inches figures of r² are of 1/inch.
    let inch = read(Format::CodeV, &text.replace("EPD 5", "DIM I; EPD 0.2"));
    assert!((first(&inch, 0.0, 550.0).efl / 25.4 - 250.0).abs() < 1e-9);
    let special = |what: &str| {
        let text =
            format!("RDM; EPD 5; WL 587.6; SO 0 1e14; S 50 4 NBK7_SCHOTT; STO; CIR 4; {what}; S 1e20 90; CIR 9; SI 0 0; GO");
        import::read(text.as_bytes(), Format::CodeV, "test")
    };
    let (u, v) = (0.3f64, -0.4f64);
    let sag = |what: &str| special(what).unwrap_or_else(|e| panic!("{e}")).surfaces[0].profile.sag(5.0 * u, 5.0 * v).unwrap();
    let conic = 0.02 * 6.25 / (1.0 + (1.0 - 0.5 * 0.02f64.powi(2) * 6.25).sqrt());
    // C4 is x², C8 x²y; then fringe terms from C4, Z5 = ρ² cos 2θ at C8.
    assert!(
        (sag("SPS XYP; SCO K -0.5; SCO NRADIUS 5; SCO C4 0.1; SCO C8 0.2; SCC C4 100") - conic - 0.1 * u * u - 0.2 * u * u * v)
            .abs()
            < 1e-14
    );
    assert!((sag("SPS ZFR; SCO C1 -0.5; SCO C3 5; SCO C8 0.1") - conic - 0.1 * (u * u - v * v)).abs() < 1e-14);
    assert!(special("SPS ODD").unwrap_err().to_string().contains("of special surfaces XYP and ZFR"));
}

#[test]
fn configurations_become_zoom_positions_or_a_near_focus() {
    let surfaces = [
        " STOP; TYPE STANDARD; CURV 0.01; DISZ 4; GLAS N-BK7 0 0; DIAM 6",
        " TYPE STANDARD; CURV 0; DISZ 20; DIAM 6",
        " TYPE STANDARD; CURV 0.02; DISZ 3; GLAS N-BK7 0 0; DIAM 8",
        " TYPE STANDARD; CURV 0; DISZ 60; DIAM 8",
    ];
    let tail = "MNUM 3 1\nTHIC 2 1 20 0 0 0 1 1 1 0 0 \"\" 0\nTHIC 2 2 50 0 0 0 1 1 1 0 0 \"\" 0\nTHIC 2 3 5 0 0 0 1 1 1 0 0 \"\" 0\n\
                YFIE 1 1 10 0\nYFIE 1 2 5 0\nMOFF 0 1 \"\" 0 0\n";
    let p = read(Format::Zemax, &zemax(&surfaces, tail));
    // In the order of focal lengths: the closer the two, the shorter.
    assert_eq!(p.surfaces[1].gap.values, [[5.0, 20.0, 50.0]]);
    for (i, gap) in [5.0, 20.0, 50.0].into_iter().enumerate() {
        let (n, at) = (p.surfaces[0].glass.index(D_NM), first(&p, i as f64, D_NM).efl);
        // Two thick plane-convex lenses: reduced gap = gap + 4/n behind the first vertex's plane side.
        let (a, b, d) = ((n - 1.0) * 0.01, (n - 1.0) * 0.02, gap + 4.0 / n);
        assert!((at * (a + b - a * b * d) - 1.0).abs() < 1e-12 && (p.zoom[i] - at).abs() < 1e-9, "{i}: {at}");
    }
    assert!(p.notes.iter().any(|n| n.contains("YFIE differ")), "{:?}", p.notes);
    assert_eq!(diopter_lens::prescription::read_toml(&p.to_toml(), "x").unwrap().zoom.len(), 3);
    // Far and near.
    let tail = "MNUM 2 1\nTHIC 0 1 INFINITY 0\nTHIC 0 2 1000 0\nTHIC 4 1 60 0\nTHIC 4 2 66 0\n";
    let p = read(Format::Zemax, &zemax(&surfaces, tail));
    assert_eq!(p.surfaces[3].gap.values, [[60.0], [66.0]]);
    assert_eq!(p.close_focus, Some(1000.0 + 4.0 + 20.0 + 3.0 + 66.0));
    // What is no zoom stays as it stands.
    let p = read(Format::Zemax, &zemax(&surfaces, "MNUM 2 1\nCRVT 1 1 0.01 0\nCRVT 1 2 0.02 0\n"));
    assert!(p.zoom.is_empty() && p.notes.iter().any(|n| n.contains("CRVT differ")), "{:?}", p.notes);
    assert!(error(Format::Zemax, &zemax(&surfaces, "MNUM 2 1\nTHIC 2 3 5 0\n")).contains("from 1 to 2"));
    let code_v = "RDM; EPD 5; WL 587.6; SO 0 1e14; S 100 4 NBK7_SCHOTT; STO; CIR 6; S 1e20 20; CIR 6; S 50 3 NBK7_SCHOTT; CIR 8; S 1e20 60; CIR 8; SI 0 0; ZOO 3; ";
    for zoom in ["ZOO THI S2 20 50 5; ZOO YAN 1 2 3; GO", "THI S2 Z1 20; THI S2 Z2 50; THI S2 Z3 5; GO"] {
        let p = read(Format::CodeV, &format!("{code_v}{zoom}"));
        assert_eq!(p.surfaces[1].gap.values, [[5.0, 20.0, 50.0]], "{zoom}");
    }
    assert!(error(Format::CodeV, &format!("{code_v}ZOO RDY S1 1 2 3")).contains("of lenses only gaps"));
    assert!(error(Format::CodeV, &format!("{code_v}ZOO THI S2 1 2 3 4")).contains("position 4"));
}

/// The doublet of the OSLO user's guide ("Assignment Commands"), in its own commands.
const DOUBLET: &str = "// OSLO 5.00 31567     0     0\nLEN NEW \"He-ne f/2 doublet focusing lens\" 60 5\nEBR  15.0\nANG  0.0000572957795\nDES  \"OSLO\"\nUNI  1.0\n\
SNO1 \"a note; with a semicolon\"\nAIR\nTH   1.0e+20\nAP  9.9999999977e+13\nNXT\nGLA N-LASF43\nRD   100.0\nTH   5.0\nNXT\nAIR\nTH   1.0\nNXT\nPK  GLA  -2\nRD   50.0\n\
TH   5.0\nNXT\nAIR\nPU   -0.25\nPY   0.0\nNXT\nAIR\nCALLBACK  1\nWV 0.6328\nWW 1.0\nEND  5\nVAR NEW\nV 1 0 CV\nEND\n";

#[test]
fn oslo_files_are_read_with_solves_and_pickups() {
    let p = read(Format::Oslo, DOUBLET);
    assert_eq!((p.name.as_str(), p.surfaces.len()), ("He-ne f/2 doublet focusing lens", 4));
    assert_eq!(p.surfaces[2].glass, p.surfaces[0].glass);
    // A beam of 15 mm that leaves with a slope of −0.25 has a focal length of 60 mm, and the film is where it meets the axis.
    let f = first(&p, 0.0, 632.8);
    assert!((f.efl - 60.0).abs() < 1e-9 && (f.bfl - p.surfaces[3].gap.at(0.0, 0.0)).abs() < 1e-9, "{f:?}");
    let text = DOUBLET
        .replace("GLA N-LASF43", "GLA 1.8; CC -0.5; AD 1e-6; ASP ASR 3; AS3 2e-9")
        .replace("UNI  1.0", "UNI 10")
        .replace("PU   -0.25", "RD -40; AST; AP CHK 14");
    let p = read(Format::Oslo, &text);
    let Profile::Asphere(a) = &p.surfaces[0].profile else { panic!("{:?}", p.surfaces[0]) };
    assert!(
        (a.c - 1e-3).abs() < 1e-18 && a.k == -0.5 && (a.a[4] - 1e-9).abs() < 1e-24 && (a.a[6] - 2e-14).abs() < 1e-28,
        "{a:?}"
    );
    assert!(p.surfaces[3].stop && p.surfaces[3].semi_diameter == Some(140.0) && p.surfaces[1].gap.at(0.0, 0.0) == 10.0);
    // Without CHK the stop is no smaller than the beam of EBR.
    let small = read(Format::Oslo, &DOUBLET.replace("GLA N-LASF43", "GLA N-LASF43; AST; AP 3"));
    assert!((small.surfaces[0].semi_diameter.unwrap() - 15.0).abs() < 1e-3, "{:?}", small.surfaces[0].semi_diameter);
    assert!(error(Format::Oslo, &DOUBLET.replace("GLA N-LASF43", "GLA NOGLASS1")).contains("surface 1: "));
    assert!(error(Format::Oslo, &DOUBLET.replace("PK  GLA  -2", "PK GLA -9")).contains("earlier surface"));
    assert!(error(Format::Oslo, &DOUBLET.replace("RD   50.0", "TLA 10")).contains("TLA 10"));
    assert!(error(Format::Oslo, &DOUBLET.replace("RD   50.0", "RD x")).contains("RD x: expected a number"));
    assert!(error(Format::Oslo, "RD 50").contains("LEN NEW"));
    assert!(error(Format::Oslo, "LEN NEW \"x\" 1 1\nNXT\nEND 1").contains("no surfaces"));
}

/// A singlet of f = 50 mm, and 10 mm behind it a plane in air: with its lines in each format.
fn singlet_and_plane(format: Format, plane: &str, fields: &str) -> String {
    match format {
        Format::Zemax => format!(
            "MODE SEQ\nUNIT MM\nENPD 20\nGCAT SCHOTT\n{fields}WAVM 1 0.587562 1\nPWAV 1\nSURF 0\n TYPE STANDARD\n DISZ INFINITY\n\
             SURF 1\n STOP\n TYPE STANDARD\n CURV 0.02\n DISZ 5\n GLAS N-BK7 0 0 1.5 40 0 0 0\n DIAM 12 1\nSURF 2\n TYPE STANDARD\n CURV -0.02\n DISZ 10\n DIAM 12 1\n\
             SURF 3\n TYPE STANDARD\n CURV 0\n DISZ 35\n{plane}\nSURF 4\n TYPE STANDARD\n CURV 0\n DISZ 0\n"
        ),
        Format::CodeV => format!(
            "RDM;LEN\nEPD 20\nWL 587.562\n{fields}SO 0 1e13\nS 50 5 NBK7_SCHOTT; STO; CIR 12\nS -50 10; CIR 12\nS 0 35\n{plane}\nSI 0 0\nGO\n"
        ),
        _ => format!(
            "LEN NEW \"x\" 1 4\nEBR 10\n{fields}UNI 1\nTH 1e20\nNXT\nRD 50\nTH 5\nGLA N-BK7\nAST\nAP 12\nNXT\nRD -50\nTH 10\nAIR\nAP 12\nNXT\nTH 35\nAIR\n{plane}\nNXT\nAIR\nWV 0.587562\nEND 4\n"
        ),
    }
}

#[test]
fn planes_in_air_stay_where_they_stop_light() {
    for (format, rim, drawn) in [
        (Format::Zemax, " DIAM 5 1\n CLAP 0 5 0", " DIAM 5 1"),
        (Format::Zemax, " DIAM 5 1\n FLAP 0 5 0", " DIAM 5 1"),
        (Format::CodeV, "CIR 5", ""),
        (Format::Oslo, "AP CHK 5", "AP 5"),
    ] {
        let p = read(format, &singlet_and_plane(format, rim, ""));
        assert_eq!((p.surfaces.len(), p.surfaces[2].semi_diameter), (3, Some(5.0)), "{format:?}: {:?}", p.notes);
        assert_eq!(read(format, &singlet_and_plane(format, drawn, "")).surfaces.len(), 2, "{format:?}");
        // And in what is written of it.
        for to in [ExportFormat::Zemax, ExportFormat::CodeV] {
            let written = export::write(&p, State::default(), to).unwrap().text;
            let back = read(if to == ExportFormat::Zemax { Format::Zemax } else { Format::CodeV }, &written);
            let shape =
                |p: &Prescription| -> Vec<_> { p.surfaces.iter().map(|s| (s.profile.curvature(), s.semi_diameter)).collect() };
            assert_eq!(shape(&back), shape(&p), "{format:?} {to:?}");
        }
    }
}

#[test]
fn files_that_are_cut_short_are_refused() {
    for (format, ends) in [
        (Format::Zemax, &["SURF 3", " DISZ 10"][..]),
        (Format::CodeV, &["SI 0 0", "S 0 35"]),
        (Format::Oslo, &["END 4", "WV 0.5"]),
    ] {
        let whole = singlet_and_plane(format, "", "");
        for end in ends {
            let cut = &whole[..whole.rfind(end).unwrap()];
            let told = error(format, cut);
            assert!(told.contains("cut short"), "{format:?} before {end}: {told}");
        }
    }
    let mixed = singlet_and_plane(Format::Zemax, "", "").replace("SURF 3", "SURF 5");
    assert!(error(Format::Zemax, &mixed).contains("SURF 5: expected SURF 3"));
}

#[test]
fn fields_of_any_kind_become_angles() {
    let angles = |format: Format, fields: &str| {
        let p = read(format, &singlet_and_plane(format, "", fields));
        (p.usage.field_angles_deg.clone(), p.usage.vignetting.clone(), p)
    };
    // As many as the head counts, also one on the axis behind others.
    assert_eq!(angles(Format::Zemax, "FTYP 0 0 3 1 0 0 0\nXFLN 0 0 0 0\nYFLN 10 5 0 0\n").0, [10.0, 5.0, 0.0]);
    // By hand: at infinity a paraxial height is f tan θ; in x and y by their common tangent.
    let f = first(&angles(Format::Zemax, "").2, 0.0, D_NM).efl;
    let degrees = |tangent: f64| tangent.atan().to_degrees();
    for (format, fields, expected) in [
        (Format::Zemax, "FTYP 2 0 2 1 0 0 0\nYFLN 0 10\n", degrees(10.0 / f)),
        (Format::CodeV, "YIM 0 10\n", degrees(10.0 / f)),
        (Format::Oslo, "GIH 10\n", degrees(10.0 / f)),
        (
            Format::Zemax,
            "FTYP 0 0 2 1 0 0 0\nXFLN 0 3\nYFLN 0 4\n",
            degrees(3f64.to_radians().tan().hypot(4f64.to_radians().tan())),
        ),
        (Format::CodeV, "XAN 0 5\n", 5.0),
    ] {
        let (found, _, p) = angles(format, fields);
        assert!((found.last().unwrap() - expected).abs() < 1e-6, "{fields}: {found:?}, expected {expected}; {:?}", p.notes);
    }
    // Beyond what the lens images there is no angle.
    let (none, _, p) = angles(Format::Zemax, "FTYP 3 0 2 1 0 0 0\nYFLN 0 4000\n");
    assert!(none.is_empty() && p.notes.iter().any(|n| n.contains("beyond")), "{none:?} {:?}", p.notes);
    // The chief ray of a real height lands there.
    let (found, _, p) = angles(Format::Zemax, "FTYP 3 0 2 1 0 0 0\nYFLN 0 10\n");
    let system = System::at(&p, State::default());
    let chief = diopter_lens::analysis::Bench::at_infinity(&system).field_of_height(10.0);
    assert!((found[1] - chief).abs() < 1e-6 && (found[1] - degrees(10.0 / f)).abs() > 0.01, "{found:?} {chief}");
    // An object 200 mm before the first surface, which is the stop: seen from its vertex. What lies above the axis is cut from the other side.
    let near = singlet_and_plane(Format::Zemax, "", "FTYP 1 0 2 1 0 0 0\nYFLN 0 20\nVDYN 0 0.1\nVCYN 0 0.2\n")
        .replace("DISZ INFINITY", "DISZ 200");
    let p = read(Format::Zemax, &near);
    assert!((p.usage.field_angles_deg[1] - degrees(0.1)).abs() < 1e-6, "{:?}", p.usage.field_angles_deg);
    assert!(
        (p.usage.vignetting[1][0] - 0.3).abs() < 1e-12 && (p.usage.vignetting[1][1] - 0.1).abs() < 1e-12,
        "{:?}",
        p.usage.vignetting
    );
    assert!(p.notes.iter().any(|n| n.contains("heights of the object")), "{:?}", p.notes);
}

#[test]
fn vignetting_factors_pass_through_both_formats() {
    let p = read(Format::CodeV, &singlet_and_plane(Format::CodeV, "", "YAN 0 10\nVUY 0 0.3\nVLY 0 0.1\n"));
    assert_eq!(p.usage.vignetting, [[0.0, 0.0], [0.3, 0.1]]);
    for (to, from) in [(ExportFormat::Zemax, Format::Zemax), (ExportFormat::CodeV, Format::CodeV)] {
        let back = read(from, &export::write(&p, State::default(), to).unwrap().text);
        for (a, b) in back.usage.vignetting.as_flattened().iter().zip(p.usage.vignetting.as_flattened()) {
            assert!((a - b).abs() < 1e-12, "{to:?}: {:?}", back.usage.vignetting);
        }
    }
}

#[test]
fn wavelengths_without_weight_do_not_count() {
    let with = |weights: [f64; 3], primary: usize| {
        let [a, b, c] = weights;
        let waves = format!("WAVM 1 0.486133 {a}\nWAVM 2 0.587562 {b}\nWAVM 3 0.656273 {c}\nPWAV {primary}\n");
        let p = read(Format::Zemax, &singlet_and_plane(Format::Zemax, "", "").replace("WAVM 1 0.587562 1\nPWAV 1\n", &waves));
        (p.usage.wavelengths_nm.iter().map(|nm| nm.round() as u32).collect::<Vec<_>>(), p.usage.reference, p.notes.join(" "))
    };
    let (all, reference, notes) = with([1.0, 1.0, 1.0], 2);
    assert_eq!((all, reference), (vec![486, 588, 656], 1));
    assert!(!notes.contains("weights"), "{notes}");
    let (two, reference, notes) = with([0.0, 1.0, 0.5], 3);
    assert_eq!((two, reference), (vec![588, 656], 1));
    assert!(notes.contains("weights"), "{notes}");
    assert!(with([1.0, 1.0, 1.0], 9).2.contains("PWAV 9"));
}

#[test]
fn glasses_of_the_catalogues_that_a_file_names_come_first() {
    let index = |catalogue: &str, glass: &str| {
        let text = singlet_and_plane(Format::Zemax, "", "").replace("GCAT SCHOTT", catalogue).replace("N-BK7", glass);
        read(Format::Zemax, &text).surfaces[0].glass.index(D_NM)
    };
    // Malitson 1964: barium fluoride; Hoya's BAF2 is a glass of 1.5697.
    assert!((index("GCAT INFRARED", "BAF2") - 1.4744).abs() < 2e-4, "{}", index("GCAT INFRARED", "BAF2"));
    assert!((index("GCAT HOYA", "BAF2") - 1.5697).abs() < 2e-4);
    // Known to Schott's list by its name alone, and by its figures to that of glasses no longer made.
    assert!((index("GCAT SCHOTT", "B270") - 1.523).abs() < 2e-3, "{}", index("GCAT SCHOTT", "B270"));
}

#[test]
fn inferred_rims_pass_the_beam_of_decentred_surfaces() {
    let text = "RDM;LEN\nEPD 20\nWL 587.6\nYAN 0\nSO 0 1e13\nS 60 6 NBK7_SCHOTT\nSTO\nS -60 20\nS 80 3 NSF5_SCHOTT\nYDE 3\nS -200 30\nSI 0 0\nGO\n";
    for text in [text.to_owned(), text.replace("YDE 3", "XDE 3"), text.replace("YDE 3", "XDE -3")] {
        let p = read(Format::CodeV, &text);
        let setting = Setting { focal_length: None, f_number: None, focus: Focus::Infinity, iris: None, film_mm: [10.0, 10.0] };
        let lens = CompoundLens::new(Arc::new(p.clone()), &setting).unwrap();
        let first = first(&p, 0.0, 587.6);
        assert!((first.efl / lens.f_number() - 20.0).abs() < 0.02, "{text}: {}", first.efl / lens.f_number());
    }
}

#[test]
fn lenses_are_written_with_the_fields_that_fall_on_their_picture() {
    for name in ["double-gauss-50mm", "fisheye-10.5mm-f2.8"] {
        let p = diopter_lens::embedded(name).unwrap();
        let back = read(Format::Zemax, &export::write(&p, State::default(), ExportFormat::Zemax).unwrap().text);
        let most = back.usage.field_angles_deg.iter().copied().fold(0.0, f64::max);
        let system = System::at(&p, State::default());
        let edge = diopter_lens::analysis::Bench::at_infinity(&system).field_of_height(0.5 * p.image_circle.unwrap());
        assert!((most - edge).abs() < 0.01 && most > 20.0, "{name}: {most}, {edge}");
    }
}

/// Prints name, wavelength, focal length and back focus of every lens file in the folder that DIOPTER_LENS_FILES names.
#[test]
#[ignore = "needs a folder of files: DIOPTER_LENS_FILES"]
fn first_order_of_a_folder_of_files() {
    let folder = std::env::var("DIOPTER_LENS_FILES").expect("DIOPTER_LENS_FILES: the folder of the files");
    let mut files: Vec<_> = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()).collect();
    files.sort();
    for path in files {
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        let Some(format) = Format::of(&name) else { continue };
        match import::read(&std::fs::read(&path).unwrap(), format, &name) {
            Ok(p) => {
                let nm = p.usage.wavelengths_nm.get(p.usage.reference).copied().unwrap_or(D_NM);
                let f = first(&p, 0.0, nm);
                println!("{name}\t{nm}\t{:.9}\t{:.9}\t{}", f.efl, f.bfl, p.notes.join("; "));
            }
            Err(e) => println!("{name}\terror\t{e}"),
        }
    }
}
