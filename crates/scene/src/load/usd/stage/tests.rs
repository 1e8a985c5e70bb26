use super::super::layer::Field;
use super::*;

fn files<'a>(all: &'a [(&'a str, &'a str)]) -> impl Fn(&str) -> Result<Vec<u8>, String> + Sync + 'a {
    move |name: &str| {
        let found = all.iter().find(|(n, _)| *n == name);
        found.map(|(_, text)| text.as_bytes().to_vec()).ok_or_else(|| "there is no such file".to_owned())
    }
}

fn number(stage: &mut Stage, path: &str, name: &str) -> Option<f64> {
    let prim = stage.prim(path).unwrap().unwrap_or_else(|| panic!("{path}"));
    stage.value(&prim, name).unwrap().and_then(|v| v.number())
}

#[test]
fn opinions_are_as_strong_as_their_arcs() {
    let all = [
        (
            "a/b.usda",
            "#usda 1.0\n( defaultPrim = \"X\" subLayers = [@../c.usda@] )\n\
            def \"X\" { int r = 3\n int p = 3\n def \"Y\" { int y = 3\n rel t = </X/Z>\n rel out = </Elsewhere> } }",
        ),
        ("c.usda", "#usda 1.0\nover \"X\" { int r = 4\n int sub = 4 }"),
        ("p.usda", "#usda 1.0\ndef \"P\" { int p = 5\n int last = 5 }"),
    ];
    let fetch = files(&all);
    let text = "#usda 1.0\nclass \"_C\" { int i = 1\n int r = 1\n int v = 1 }\n\
        def \"A\" ( references = @./a/b.usda@\n payload = @p.usda@</P>\n inherits = </_C>\n variantSets = \"s\"\n variants = {string s = \"v\"} )\n\
        { int local = 0\n int i = 0\n variantSet \"s\" = { \"v\" { int v = 2\n int w = 2\n int r = 2 \n over \"Y\" { int from = 2 } } \"w\" { int w = 9 } } }\n\
        def \"B\" ( references = </A> ) { over \"Y\" { int y = 7 } }";
    let mut stage = Stage::new(text.into(), "s.usda", &fetch).unwrap();
    for (name, value) in [("local", 0), ("i", 0), ("r", 1), ("v", 1), ("w", 2), ("sub", 4), ("p", 3), ("last", 5)] {
        assert_eq!(number(&mut stage, "/A", name), Some(f64::from(value)), "{name}");
        assert_eq!(number(&mut stage, "/B", name), Some(f64::from(value)), "{name}");
    }
    assert_eq!((number(&mut stage, "/A/Y", "y"), number(&mut stage, "/B/Y", "y")), (Some(3.0), Some(7.0)));
    assert_eq!(number(&mut stage, "/A/Y", "from"), Some(2.0));
    let y = stage.prim("/B/Y").unwrap().unwrap();
    assert_eq!(stage.targets(&y, "t", Key::TargetPaths).unwrap(), ["/B/Z"]);
    assert!(stage.targets(&y, "out", Key::TargetPaths).unwrap().is_empty());
    let b = stage.prim("/B").unwrap().unwrap();
    assert!(stage.is_drawn(&b).unwrap() && stage.missing.is_empty());
    let class = stage.prim("/_C").unwrap().unwrap();
    assert!(!stage.is_drawn(&class).unwrap() && stage.is_drawn(&y).unwrap());
    let root = stage.prim("/").unwrap().unwrap();
    assert_eq!(stage.children(&root).unwrap().len(), 3);
}

#[test]
fn names_of_children_that_are_paths_are_passed_over() {
    let fetch = files(&[]);
    let mut stage = Stage::new("#usda 1.0\ndef \"A\" { def \"B\" {} }".into(), "s.usda", &fetch).unwrap();
    let root = stage.layers[0].specs.get_mut("/").unwrap();
    let children = root.fields.iter_mut().find(|(key, _)| *key == Key::PrimChildren).unwrap();
    // The empty one would be the root again, for ever.
    let names: Vec<Arc<str>> = ["", "A", "A/B", "/", "A{v=a}", "A.x"].map(Arc::from).to_vec();
    children.1 = Field::Ready(Value::Texts(names.into()));
    let root = stage.prim("/").unwrap().unwrap();
    let paths: Vec<String> = stage.children(&root).unwrap().iter().map(|p| p.path.clone()).collect();
    assert_eq!(paths, ["/A"]);
}

#[test]
fn what_goes_round_is_an_error_and_what_is_missing_is_noted() {
    let all = [
        ("self.usda", "#usda 1.0\n( subLayers = [@other.usda@] )\n"),
        ("other.usda", "#usda 1.0\n( subLayers = [@self.usda@] )\n"),
        ("back.usda", "#usda 1.0\ndef \"P\" { def \"Q\" ( references = @back.usda@</P> ) {} }"),
        ("twin.usda", "#usda 1.0\ndef \"P\" ( references = @twin.usda@</Q> ) {}\ndef \"Q\" ( references = @twin.usda@</P> ) {}"),
    ];
    let fetch = files(&all);
    let walk = |text: &str| -> Read<Vec<String>> {
        let mut stage = Stage::new(text.into(), "s.usda", &fetch)?;
        let mut open = vec![stage.prim("/")?.unwrap()];
        while let Some(prim) = open.pop() {
            open.extend(stage.children(&prim)?);
        }
        Ok(stage.missing)
    };
    for text in [
        "( subLayers = [@self.usda@] )",
        "def \"A\" ( references = </A> ) {}",
        "def \"A\" { def \"B\" ( references = </A> ) {} }",
        "def \"A\" ( references = @back.usda@</P> ) {}",
        "def \"A\" ( references = @twin.usda@</P> ) {}",
        "def \"A\" ( inherits = </B> ) {}\ndef \"B\" ( inherits = </A> ) {}",
    ] {
        let e = walk(&format!("#usda 1.0\n{text}")).unwrap_err().to_string();
        assert!(e.contains("itself") || e.contains("sublayers"), "{text}: {e}");
    }
    let missing =
        walk("#usda 1.0\ndef \"A\" ( references = @gone.usda@ ) {}\ndef \"B\" ( references = @gone.usda@ ) {}").unwrap();
    assert_eq!(missing, ["gone.usda (there is no such file)"]);
    // Doubling thirty times would be a thousand million opinions.
    let mut text = "#usda 1.0\n".to_owned();
    for i in 0..30 {
        let next = i + 1;
        text += &format!("def \"A{i}\" ( references = [</B{next}>, </C{next}>] ) {{}}\n");
        text += &format!("def \"B{next}\" ( references = </A{next}> ) {{}}\ndef \"C{next}\" ( references = </A{next}> ) {{}}\n");
    }
    assert!(walk(&text).unwrap_err().to_string().contains("references to references"));
}

#[test]
fn paths_are_joined_as_files_are() {
    for (folder, path, whole) in [
        ("", "./a.usd", "a.usd"),
        ("x/y/", "../a.usd", "x/a.usd"),
        ("x/", "../../a.usd", "../a.usd"),
        ("x/", "/a.usd", "/a.usd"),
        ("x/", "b\\c.usd", "x/b/c.usd"),
        ("../x/", "./y/../z", "../x/z"),
    ] {
        assert_eq!(joined(folder, path), whole, "{folder} {path}");
    }
    assert_eq!((folder_of("a/b.usd").as_str(), folder_of("b.usd").as_str()), ("a/", ""));
}

#[test]
fn times_of_references_are_shifted() {
    let all = [("b.usda", "#usda 1.0\ndef \"X\" { double v.timeSamples = { 0: 1, 10: 2, 20: 3 } }")];
    let fetch = files(&all);
    let text = "#usda 1.0\n( startTimeCode = 30 )\ndef \"A\" ( references = @b.usda@</X> (offset = 5; scale = 2) ) {}";
    let mut stage = Stage::new(text.into(), "s.usda", &fetch).unwrap();
    let prim = stage.prim("/A").unwrap().unwrap();
    let found = stage.attribute(&prim, "v").unwrap().unwrap();
    let times: Vec<f64> = stage.samples(&found).unwrap().unwrap().iter().map(|s| s.0).collect();
    assert_eq!(times, [5.0, 25.0, 45.0]);
    // A quarter of the way from 25 to 45.
    assert_eq!(number(&mut stage, "/A", "v"), Some(2.25));
}

#[test]
fn time_codes_of_layers_are_as_long_as_they_say() {
    // OpenUSD 26.11 gives the same times.
    let all = [
        (
            "inner.usda",
            "#usda 1.0\n( defaultPrim = \"A\"\n timeCodesPerSecond = 48 )\ndef \"A\" { double v.timeSamples = { 0: 0, 48: 1 } }",
        ),
        ("sub.usda", "#usda 1.0\n( framesPerSecond = 48 )\ndef \"X\" ( references = @inner.usda@ (offset = 48) ) {}"),
    ];
    let fetch = files(&all);
    let text = "#usda 1.0\n( subLayers = [@sub.usda@] )\ndef \"Y\" ( references = @inner.usda@ (offset = 10; scale = 2) ) {}";
    let mut stage = Stage::new(text.into(), "s.usda", &fetch).unwrap();
    for (path, expected) in [("/X", [24.0, 48.0]), ("/Y", [10.0, 58.0])] {
        let prim = stage.prim(path).unwrap().unwrap();
        let found = stage.attribute(&prim, "v").unwrap().unwrap();
        let times: Vec<f64> = stage.samples(&found).unwrap().unwrap().iter().map(|s| s.0).collect();
        assert_eq!(times, expected, "{path}");
    }
}

#[test]
fn overrides_below_instances_are_discarded() {
    let all = [
        (
            "a.usda",
            "#usda 1.0\n( defaultPrim = \"A\" )\ndef \"A\" ( variantSets = \"s\" ) { int own = 1\ndef \"q\" { int v = 1 }\nvariantSet \"s\" = { \"b\" { over \"q\" { int w = 2 } } } }",
        ),
        (
            "b.usda",
            "#usda 1.0\n( defaultPrim = \"B\" )\ndef \"B\" { def \"I\" ( instanceable = true\n references = @a.usda@ ) { over \"q\" { int v = 5 } } }",
        ),
    ];
    let fetch = files(&all);
    let body = "{ int own = 7\nover \"q\" { int v = 9 }\ndef \"new\" {} }";
    let text = format!(
        "#usda 1.0\ndef \"I\" ( instanceable = true\n references = @a.usda@\n variants = {{ string s = \"b\" }} ) {body}\ndef \"F\" ( references = @a.usda@ ) {body}\n\
        def \"O\" ( references = @b.usda@ ) {{ over \"I\" {body} }}\ndef \"N\" ( instanceable = true ) {body}"
    );
    // OpenUSD 26.11 gives the same numbers.
    let mut stage = Stage::new(text.into(), "s.usda", &fetch).unwrap();
    assert_eq!(number(&mut stage, "/I/q", "w"), Some(2.0));
    for (path, value, children) in [("/I", 1.0, 1), ("/F", 9.0, 2), ("/O/I", 1.0, 1), ("/N", 9.0, 2)] {
        assert_eq!(number(&mut stage, &format!("{path}/q"), "v"), Some(value), "{path}");
        // The instance itself is edited as any other prim.
        assert_eq!(number(&mut stage, path, "own"), Some(7.0), "{path}");
        let prim = stage.prim(path).unwrap().unwrap();
        assert_eq!(stage.children(&prim).unwrap().len(), children, "{path}");
    }
}

#[test]
fn arcs_rank_by_their_kind_before_where_they_come_from() {
    let all = [
        (
            "chair.usda",
            "#usda 1.0\ndef \"chair\" ( variants = { string size = \"small\" } variantSets = \"size\" ) { int v = 1\n variantSet \"size\" = { \"small\" { int w = 1 } \"big\" { int w = 2 } } }",
        ),
        ("set.usda", "#usda 1.0\ndef \"set\" { def \"c\" ( payload = @chair.usda@</chair> ) {} }"),
    ];
    let fetch = files(&all);
    let text = "#usda 1.0\n\
        def \"A\" ( variants = { string look = \"x\" } variantSets = \"look\" ) {\n\
          def \"geo\" ( references = @chair.usda@</chair> ) {}\n\
          variantSet \"look\" = { \"x\" { over \"geo\" ( variants = { string size = \"big\" } ) { int v = 9 } } } }\n\
        def \"B\" ( references = </P> ) { def \"c\" ( payload = @chair.usda@</chair> ) {} }\n\
        def \"P\" { def \"c\" { int v = 7 } }\n\
        def \"S\" ( references = @set.usda@</set> ) {}\n\
        def \"one\" ( references = </S/c> ) {}\n\
        def \"two\" ( payload = @set.usda@</set/c> ) {}\n\
        def \"three\" ( inherits = </S/c> ) {}";
    let mut stage = Stage::new(text.into(), "s.usda", &fetch).unwrap();
    // OpenUSD 26.11 gives the same numbers. A variant around a prim is stronger than its own reference, and chooses its variant.
    assert_eq!((number(&mut stage, "/A/geo", "v"), number(&mut stage, "/A/geo", "w")), (Some(9.0), Some(2.0)));
    // A reference around it than its own payload.
    assert_eq!((number(&mut stage, "/B/c", "v"), number(&mut stage, "/B/c", "w")), (Some(7.0), Some(1.0)));
    // What arcs lead to that is only there by arcs of what is around it.
    for path in ["/S/c", "/one", "/two", "/three"] {
        assert_eq!((number(&mut stage, path, "v"), number(&mut stage, path, "w")), (Some(1.0), Some(1.0)), "{path}");
    }
}

#[test]
fn lists_of_references_are_edited_across_layers() {
    let all = [
        ("a.usda", "#usda 1.0\ndef \"A\" { int a = 1\n int v = 1 }"),
        ("b.usda", "#usda 1.0\ndef \"B\" { int b = 2\n int v = 2 }"),
        (
            "under.usda",
            "#usda 1.0\ndef \"X\" ( prepend references = [@a.usda@</A>, @b.usda@</B>] ) {}\ndef \"Y\" ( prepend references = [@a.usda@</A>, @b.usda@</B>] ) {}",
        ),
    ];
    let fetch = files(&all);
    let text = "#usda 1.0\n( subLayers = [@under.usda@] )\nover \"X\" ( delete references = @a.usda@</A> ) {}\nover \"Y\" ( prepend references = @b.usda@</B> ) {}";
    let mut stage = Stage::new(text.into(), "s.usda", &fetch).unwrap();
    assert_eq!((number(&mut stage, "/X", "a"), number(&mut stage, "/X", "v")), (None, Some(2.0)));
    // Named again by a stronger layer it comes first.
    assert_eq!((number(&mut stage, "/Y", "a"), number(&mut stage, "/Y", "v")), (Some(1.0), Some(2.0)));
}

#[test]
fn classes_are_known_to_the_layers_around_and_what_is_specialised_is_weakest() {
    let all = [(
        "asset.usda",
        "#usda 1.0\nclass \"_C\" { int i = 1\n int s = 1 }\ndef \"X\" ( inherits = </_C> ) { def \"y\" ( inherits = </X/_D> ) {}\n class \"_D\" { int d = 1 } }\n\
         class \"_S\" { int w = 1\n int r = 1 }\ndef \"Z\" ( specializes = </_S> ) {}",
    )];
    let fetch = files(&all);
    let text = "#usda 1.0\nclass \"_C\" { int i = 5 }\nclass \"_S\" { int w = 5 }\n\
        def \"A\" ( references = @asset.usda@</X> ) { over \"_D\" { int d = 5 } }\n\
        def \"B\" ( references = [@asset.usda@</Z>, </R>] ) {}\ndef \"R\" { int r = 7 }";
    let mut stage = Stage::new(text.into(), "s.usda", &fetch).unwrap();
    // OpenUSD 26.11 gives the same numbers.
    assert_eq!((number(&mut stage, "/A", "i"), number(&mut stage, "/A", "s")), (Some(5.0), Some(1.0)));
    assert_eq!(number(&mut stage, "/A/y", "d"), Some(5.0));
    assert_eq!((number(&mut stage, "/B", "w"), number(&mut stage, "/B", "r")), (Some(5.0), Some(7.0)));
}

#[test]
fn values_lie_between_samples_at_the_first_time() {
    let fetch = files(&[]);
    let text = "#usda 1.0\n( startTimeCode = 5 )\ndef \"A\" { double d.timeSamples = { 0: 0, 10: 2 }\n int i.timeSamples = { 0: 0, 10: 2 }\n\
        float3 f.timeSamples = { 0: (0, 1, 2), 20: (4, 1, 2) }\n double before.timeSamples = { 7: 3, 8: 4 } }";
    let mut stage = Stage::new(text.into(), "s.usda", &fetch).unwrap();
    assert_eq!((number(&mut stage, "/A", "d"), number(&mut stage, "/A", "i")), (Some(1.0), Some(0.0)));
    assert_eq!(number(&mut stage, "/A", "before"), Some(3.0));
    let prim = stage.prim("/A").unwrap().unwrap();
    assert_eq!(stage.value(&prim, "f").unwrap().and_then(|v| v.doubles()).unwrap()[..], [1.0, 1.0, 2.0]);
}
