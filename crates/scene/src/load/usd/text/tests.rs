use super::*;

fn layer(text: &str) -> Read<Layer> {
    read(text.as_bytes(), "a.usda", Folder::default())
}

#[test]
fn fields_of_all_kinds_are_read() {
    let text = r#"#usda 1.0
(
    "A note"
    defaultPrim = "A"
    metersPerUnit = 0.01
    subLayers = [@b.usda@ (offset = 2; scale = 0.5), @./c.usda@]
    customLayerData = { string "a b" = "}" ; dictionary x = { int[] y = [1, 2] } }
)
/* over all */
def Xform "A" ( # a comment
    prepend references = [@x.usd@</X> (offset = 1), </Y>]
    payload = @p.usd@
    variants = { string look = "red" }
    prepend variantSets = "look"
    apiSchemas = ["Some"]
    active = false
)
{
    point3f[] points = [(1, -2.5e1, .5), (inf, 0, 1)] ( interpolation = "vertex" )
    int[] counts = [3,]
    matrix4d xformOp:transform = ( (1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (5, 6, 7, 1) )
    uniform token[] xformOpOrder = ["xformOp:transform", '!invert!x']
    asset inputs:file = @tex/a.png@
    string doc = """two "lines"
\t."""
    double t.timeSamples = { 10: 1.5, -2: None, }
    color3f inputs:c.connect = <../M/S.outputs:rgb>
    rel material:binding = </M>
    prepend rel other = [</P>, <.x>]
    float none
    variantSet "look" = {
        "red" ( active = true ) { def "B" { int i = 4 } }
        "blue" { }
    }
}
"#;
    let l = layer(text).unwrap();
    let get = |path: &str, key| l.get(path, key).unwrap().unwrap_or_else(|| panic!("{path} {key:?}"));
    assert_eq!(&*get("/A.points", Key::Default).floats().unwrap(), [1.0, -25.0, 0.5, f32::INFINITY, 0.0, 1.0]);
    assert_eq!(&**get("/A.points", Key::Interpolation).text().unwrap(), "vertex");
    assert_eq!(get("/A.xformOp:transform", Key::Default).doubles().unwrap()[12..], [5.0, 6.0, 7.0, 1.0]);
    assert_eq!(&**get("/A.doc", Key::Default).text().unwrap(), "two \"lines\"\n\t.");
    assert_eq!(&**get("/A.inputs:file", Key::Default).text().unwrap(), "tex/a.png");
    assert_eq!(get("/", Key::SubLayerOffsets).doubles().unwrap()[..], [2.0, 0.5, 0.0, 1.0]);
    let Value::Samples(samples) = get("/A.t", Key::TimeSamples) else { panic!("samples") };
    assert_eq!(samples.iter().map(|s| s.0).collect::<Vec<_>>(), [-2.0, 10.0]);
    let Value::List(list) = get("/A.inputs:c", Key::ConnectionPaths) else { panic!("a list") };
    assert_eq!(&*list.explicit.as_ref().unwrap()[0], "/M/S.outputs:rgb");
    let Value::List(list) = get("/A.other", Key::TargetPaths) else { panic!("a list") };
    assert_eq!(list.prepended.iter().map(|p| &**p).collect::<Vec<_>>(), ["/P", "/A.x"]);
    let Value::References(list) = get("/A", Key::References) else { panic!("references") };
    assert_eq!((&*list.prepended[0].prim, list.prepended[0].shift.offset, &*list.prepended[1].prim), ("/X", 1.0, "/Y"));
    assert_eq!(get("/A{look=red}B.i", Key::Default).number(), Some(4.0));
    assert_eq!(get("/A", Key::Active).number(), Some(0.0));
    assert!(l.specs.contains_key("/A.none") && l.get("/A.none", Key::Default).unwrap().is_none());
}

#[test]
fn errors_name_their_line() {
    for (text, expected) in [
        ("usda", "#usda"),
        ("#usda 1.0\ndeaf \"A\" {}", "line 2: \"deaf\""),
        ("#usda 1.0\ndef \"A\" {\n  int x = y\n}", "line 3: \"y\""),
        ("#usda 1.0\ndef \"A\" {\n  int x = [1, 2\n", "the end of the file"),
        ("#usda 1.0\ndef \"A\" {\n string x = \"a\n}", "text without end"),
        ("#usda 1.0\ndef \"A/B\" {}", "a name of letters"),
        ("#usda 1.0\n( subLayers = [@a ] )", "without end"),
    ] {
        let e = layer(text).unwrap_err().to_string();
        assert!(e.starts_with("a.usda") && e.contains(expected), "{e}");
    }
    let deep = |n: usize| format!("#usda 1.0\n{}{}", "def \"A\" {".repeat(n), "}".repeat(n));
    assert!(layer(&deep(200)).is_ok());
    assert!(layer(&deep(300)).unwrap_err().to_string().contains("deep"));
    let brackets = format!("#usda 1.0\ndef \"A\" {{ int[] x = {} }}", "[".repeat(100_000));
    assert!(layer(&brackets).unwrap_err().to_string().contains("deep"));
    let skipped = format!("#usda 1.0\n( a = {} )", "{".repeat(100_000));
    assert!(layer(&skipped).is_err());
}
