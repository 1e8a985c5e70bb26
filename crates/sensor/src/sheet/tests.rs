use super::*;

const GOOD: &str = r#"
name = "test"
format_mm = [3.6, 2.4]
pixels = [600, 400]
cfa = "mono"
response = { first_nm = 380, step_nm = 200, Y = [1.0, 1.0, 1.0] }
peak_quantum_efficiency = 0.5
full_well_e = 10000
adc_bits = 12
black_level_dn = 64
white_level_dn = 4095
iso = [[100, 2.5, 3.0]]
[sources]
"#;

#[test]
fn the_example_of_the_documentation_is_a_body() {
    let page = include_str!("../../../../docs/bodies.md");
    let example = page.split("```toml").nth(1).and_then(|rest| rest.split("```").next()).unwrap();
    let sensor = Sensor::parse(example, "docs/bodies.md").unwrap();
    assert_eq!((sensor.name.as_str(), sensor.iso.len(), sensor.dark_current.points.len()), ("my camera", 3, 2));
}

#[test]
fn levels_and_digital_gain_change_where_the_sheet_says() {
    let text = GOOD.replace("adc_bits = 12", "adc_bits = 14").replace(
        "[[100, 2.5, 3.0]]",
        "[[2000, 2.5, 3.0], [8000, 0.625, 2.0]]\ndigital_above_iso = 2500\nlevels = [[5000, 100, 16000]]",
    );
    let sensor = Sensor::parse(&text, "x").unwrap();
    let at = |iso: f64| sensor.at_iso(iso).unwrap();
    // Between settings, too: nothing is multiplied up to the limit, and what is beyond it by their ratio.
    for (iso, gain, black) in
        [(2000.0, 1.0, 64.0), (2400.0, 1.0, 64.0), (4000.0, 1.6, 64.0), (5000.0, 2.0, 100.0), (8000.0, 3.2, 100.0)]
    {
        assert!((at(iso).digital_gain - gain).abs() < 1e-12 && at(iso).black_level_dn == black, "{iso}: {:?}", at(iso));
    }
}

#[test]
fn contradictions_are_named() {
    assert!(Sensor::parse(GOOD, "x").is_ok());
    for (from, to, named) in [
        ("white_level_dn = 4095", "white_level_dn = 32", "black < white"),
        ("white_level_dn = 4095", "white_level_dn = 5000", "4095, the largest number of 12 bits"),
        ("full_well_e = 10000", "full_well_e = 0", "full_well_e"),
        ("full_well_e = 10000", "", "neither"),
        ("full_well_e = 10000", "full_well_e = 10000\nsaturation_capacity_e = 9000", "one of the two"),
        ("peak_quantum_efficiency = 0.5", "peak_quantum_efficiency = 1.2", "at most 1"),
        ("adc_bits = 12", "adc_bits = 17", "8 to 16"),
        ("step_nm = 200, Y = [1.0, 1.0, 1.0]", "step_nm = 100, Y = [1.0, 1.0]", "400 to 700 nm"),
        ("Y = [", "R = [", "Y, each with"),
        ("[[100, 2.5, 3.0]]", "[]", "at least one row"),
        ("[[100, 2.5, 3.0]]", "[[200, 2.5, 3.0], [100, 5.0, 3.0]]", "rising ISO"),
        ("[[100, 2.5, 3.0]]", "[[100, 2.5, 3.0], [200, 5.0, 3.0]]", "falls or stays"),
        ("full_well_e = 10000", "full_well_e = 2", "16 numbers"),
        ("Y = [1.0, 1.0, 1.0]", "Y = [0.0, 0.0, 0.0]", "a response somewhere"),
        ("[sources]", "dual_gain_iso = 4000\n[sources]", "above 100 and up to 100"),
        ("[sources]", "hot_pixel_fraction = 0.01\nhot_pixel_factor = 9\n[sources]", "dark_current beside it"),
        ("[sources]", "digital_above_iso = -5\n[sources]", "digital_above_iso"),
        ("[sources]", "levels = [[nan, 64, 4095]]\n[sources]", "levels"),
        ("[sources]", "[second_reading]\nrelative_exposure = 0.1\nfull_well_e = 10\nread_noise_e = 1\n[sources]", "more light"),
        ("[[100, 2.5, 3.0]]", "[[100, 2.5]]", "rows of ISO"),
        ("cfa = \"mono\"", "cfa = \"RGX\"", "x-trans"),
        ("cfa = \"mono\"", "cfa = \"RGBWH\"", "four different"),
        ("cfa = \"mono\"", "cfa = \"polarized\"", "extinction_ratio"),
        ("cfa = \"mono\"", "cfa = \"polarized\"\nextinction_ratio = 0.5", "above 1"),
        ("cfa = \"mono\"", "cfa = \"mono\"\nextinction_ratio = 100", "no pixel"),
        ("[sources]", "dark_current = [[20, -1]]\n[sources]", "dark_current"),
        ("[sources]", "crosstalk_percent = 30\n[sources]", "0 to 20"),
        ("[sources]", "typo = 1\n[sources]", "typo"),
        ("[sources]", "fullwell_e = 1\n[sources]", "did you mean `full_well_e`?"),
        ("[sources]", "", "sheet.toml: [sources] missing: expected a table"),
        ("adc_bits = 12", "", "sheet.toml: adc_bits missing: expected a line adc_bits = ..."),
        ("[sources]", "[lens]\nf_number = 2\n[sources]", "line 13"),
        (
            "{ first_nm = 380, step_nm = 200, Y = [1.0, 1.0, 1.0] }",
            "\"imx42\"",
            "sheet.toml: response \"imx42\": expected curves",
        ),
        ("{ first_nm = 380, step_nm = 200, Y = [1.0, 1.0, 1.0] }", "\"nikon_d85\"", "(did you mean \"nikon_d850\"?)"),
        ("[sources]", "[lens]\nfocal_length_mm = 0\nf_number = 2\n[sources]\nlens = \"x\"", "lens.focal_length_mm"),
        ("[sources]", "[lens]\nfocal_length_mm = 4\nf_number = 2\n[sources]", "sources.lens"),
    ] {
        let e = Sensor::parse(&GOOD.replace(from, to), "sheet.toml").expect_err(to).to_string();
        assert!(e.contains(named) && e.starts_with("sheet.toml"), "{to}: {e}");
    }
}

#[test]
fn a_saturation_capacity_becomes_a_higher_limit() {
    let s = Sensor::parse(&GOOD.replace("full_well_e", "saturation_capacity_e"), "x").unwrap();
    assert!((s.full_well_e / 10_000.0 - 1.028).abs() < 5e-3, "{}", s.full_well_e);
    assert!((saturation_capacity(s.full_well_e, 3.0) / 10_000.0 - 1.0).abs() < 5e-4);
}

#[test]
fn a_body_may_have_a_lens_of_its_own() {
    assert_eq!(Sensor::parse(GOOD, "x").unwrap().lens, None);
    let text = GOOD.replace("[sources]", "[lens]\nfocal_length_mm = 4.4\nf_number = 1.7\n[sources]\nlens = \"its maker\"");
    assert_eq!(Sensor::parse(&text, "x").unwrap().lens, Some(BodyLens { focal_length_mm: 4.4, f_number: 1.7 }));
    // The embedded ones look as wide as their sources say: 77° across the diagonal.
    let phone = Sensor::named("pixel-4a").unwrap();
    let half = 0.5 * phone.format_mm[0].hypot(phone.format_mm[1]) / phone.lens.unwrap().focal_length_mm;
    assert!((2.0 * half.atan().to_degrees() - 77.0).abs() < 0.1);
}

#[test]
fn amplifiers_and_digital_gain_make_ladders() {
    let text = GOOD
        .replace("iso = [[100, 2.5, 3.0]]", "digital_above_iso = 200")
        .replace("[sources]", "[amplifier]\niso = [100, 200, 400]\ngain = [100, 2.5]\nbefore_e = 3\nafter_dn = 2\n[sources]");
    let s = Sensor::parse(&text, "x").unwrap();
    let last = s.at_iso(400.0).unwrap();
    assert_eq!((last.gain_e_per_dn, last.digital_gain), (0.625, 2.0));
    assert!((last.read_noise_e - 3f64.hypot(1.25)).abs() < 1e-12);
}
