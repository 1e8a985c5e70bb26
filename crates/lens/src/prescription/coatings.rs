//! Coatings in the TOML form.
//!
//! `coating` of the lens or of one surface: a name (`"none"`, `"MgF2"`, `"multi"`, `"perfect"`, `"single"`, `"V"`, `"broadband"`, `"modern"`,
//! `"year"`, or one of the file's `[coatings.NAME]`), `{ recipe = "V", design_nm = 600 }`, or layers:
//! `[{ material = "MgF2", quarter_waves = 1 }, { n = 1.7, k = 0.001, thickness_nm = 81.2 }]`, also as `{ design_nm = 520, layers = [..] }`.
//! Layers count from the air to the glass, between two glasses from the object's side, on a mirror from the light's side.

use crate::coating::{Coating, DESIGN_NM, Layer, MOST_LAYERS, Material, Recipe, Stack, by_year};
use diopter_light::names::nearest;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Thickest film, nm: 1 mm.
const THICKEST_NM: f64 = 1e6;
/// Design wavelengths, nm.
const DESIGN_RANGE_NM: [f64; 2] = [300.0, 2000.0];
/// Names without layers.
const PLAIN: [(&str, Coating); 4] = [
    ("none", Coating::None),
    ("MgF2", Coating::MagnesiumFluoride),
    ("multi", Coating::Multilayer),
    ("perfect", Coating::Perfect),
];

#[derive(Deserialize)]
#[serde(
    untagged,
    expecting = "coating: expected a name such as \"MgF2\", layers such as [{ material = \"MgF2\", quarter_waves = 1 }], or { recipe = \"V\", design_nm = 600 }; a layer has material (or n and k) and thickness_nm (or quarter_waves)"
)]
pub(super) enum SheetCoating {
    Name(String),
    Layers(Vec<SheetLayer>),
    Table(SheetStack),
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SheetStack {
    recipe: Option<String>,
    design_nm: Option<f64>,
    layers: Option<Vec<SheetLayer>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SheetLayer {
    material: Option<String>,
    n: Option<f64>,
    k: Option<f64>,
    thickness_nm: Option<f64>,
    quarter_waves: Option<f64>,
}

/// What names stand for in a file.
pub(super) struct Names {
    stacks: BTreeMap<String, Coating>,
    year: Option<u16>,
}

impl Names {
    /// Reads the file's `[coatings]`; `year` is the year of the lens, where one is known.
    pub(super) fn read(sheets: BTreeMap<String, SheetCoating>, year: Option<u16>) -> Result<Names, String> {
        let mut names = Names { stacks: BTreeMap::new(), year };
        let mut stacks = BTreeMap::new();
        for (name, sheet) in sheets {
            let coating = names.coating(sheet).map_err(|what| format!("[coatings] {name}: {what}"))?;
            stacks.insert(name, coating);
        }
        names.stacks = stacks;
        Ok(names)
    }

    /// What a sheet says.
    pub(super) fn coating(&self, sheet: SheetCoating) -> Result<Coating, String> {
        match sheet {
            SheetCoating::Name(name) => self.named(&name),
            SheetCoating::Layers(layers) => stack(layers, DESIGN_NM),
            SheetCoating::Table(SheetStack { recipe, design_nm, layers }) => {
                let design = design_nm.unwrap_or(DESIGN_NM);
                let [low, high] = DESIGN_RANGE_NM;
                if !(low..=high).contains(&design) {
                    return Err(format!("coating: design_nm {design}: expected {low} to {high}"));
                }
                match (recipe, layers) {
                    (None, Some(layers)) => stack(layers, design),
                    (Some(name), None) => match self.named(&name)? {
                        Coating::Recipe(recipe, _) => Ok(Coating::Recipe(recipe, design)),
                        Coating::MagnesiumFluoride if design != DESIGN_NM => Ok(Coating::Recipe(Recipe::SingleLayer, design)),
                        other if design_nm.is_none() => Ok(other),
                        _ => Err(format!(
                            "coating \"{name}\" with design_nm: expected a recipe: {}",
                            Recipe::ALL.map(|r| r.0).join(", ")
                        )),
                    },
                    _ => Err("coating: expected either recipe or layers".into()),
                }
            }
        }
    }

    fn named(&self, name: &str) -> Result<Coating, String> {
        if let Some(found) = self.stacks.get(name) {
            return Ok(found.clone());
        }
        if let Some((_, found)) = PLAIN.iter().find(|p| p.0 == name) {
            return Ok(found.clone());
        }
        if let Some((_, recipe)) = Recipe::ALL.iter().find(|r| r.0 == name) {
            return Ok(Coating::Recipe(*recipe, DESIGN_NM));
        }
        if name == "year" {
            return match self.year {
                Some(year) => Ok(by_year(year)),
                None => Err("coating \"year\" of a lens whose year is not known: write it, such as year = 1975".into()),
            };
        }
        let known: Vec<&str> = PLAIN
            .iter()
            .map(|p| p.0)
            .chain(Recipe::ALL.iter().map(|r| r.0))
            .chain(["year"])
            .chain(self.stacks.keys().map(String::as_str))
            .collect();
        let hint = nearest(name, known.iter().copied()).map_or(String::new(), |n| format!(" (did you mean \"{n}\"?)"));
        Err(format!("unknown coating \"{name}\"{hint}: expected one of {}, or layers", known.join(", ")))
    }
}

/// The coating of a name, as `coating = "NAME"` in a prescription: for lenses that are to be looked at with another coating. `year` is what
/// "year" goes by. Fails on an unknown name, listing those there are, and on "year" without one.
pub fn coating_named(name: &str, year: Option<u16>) -> Result<Coating, String> {
    Names { stacks: BTreeMap::new(), year }.named(name)
}

fn stack(layers: Vec<SheetLayer>, design_nm: f64) -> Result<Coating, String> {
    if layers.is_empty() || layers.len() > MOST_LAYERS {
        return Err(format!("coating of {} layers: expected 1 to {MOST_LAYERS}; \"none\" for a surface without", layers.len()));
    }
    let one = |(i, l): (usize, SheetLayer)| layer(l, design_nm).map_err(|what| format!("coating: layer {}: {what}", i + 1));
    let layers = layers.into_iter().enumerate().map(one).collect::<Result<_, _>>()?;
    Ok(Coating::Stack(Arc::new(Stack { layers })))
}

fn layer(l: SheetLayer, design_nm: f64) -> Result<Layer, String> {
    let material = match (&l.material, l.n) {
        (Some(name), None) if l.k.is_none() => Material::parse(name)?,
        (None, Some(n)) => {
            let k = l.k.unwrap_or(0.0);
            if !((0.01..=20.0).contains(&n) && (0.0..=50.0).contains(&k)) {
                return Err(format!("n = {n}, k = {k}: expected n from 0.01 to 20 and k from 0 to 50"));
            }
            Material::Index { n, k }
        }
        _ => return Err("expected either material or n (with k, if it absorbs)".into()),
    };
    let thickness_nm = match (l.thickness_nm, l.quarter_waves) {
        (Some(nm), None) => nm,
        (None, Some(waves)) => {
            let index = material.index(design_nm);
            if index.im > 0.1 * index.re {
                return Err(format!("{}: a metal has no quarter wave: write thickness_nm", material.describe()));
            }
            0.25 * waves * design_nm / index.re
        }
        _ => return Err("expected either thickness_nm or quarter_waves".into()),
    };
    if !(thickness_nm > 0.0 && thickness_nm <= THICKEST_NM) {
        return Err(format!("a thickness of {thickness_nm} nm: expected more than 0 and at most {THICKEST_NM}"));
    }
    Ok(Layer { material, thickness_nm })
}

/// A coating as the TOML form has it; reading it back gives the same.
pub(super) fn written(coating: &Coating) -> String {
    let text = |s: &str| toml::Value::from(s).to_string();
    match coating {
        Coating::Recipe(recipe, design_nm) if *design_nm == DESIGN_NM => text(recipe.name()),
        Coating::Recipe(recipe, design_nm) => format!("{{ recipe = {}, design_nm = {design_nm} }}", text(recipe.name())),
        Coating::Stack(stack) => {
            let layer = |l: &Layer| {
                let material = match &l.material {
                    Material::Index { n, k } => format!("n = {n}, k = {k}"),
                    other => format!("material = {}", text(&other.describe())),
                };
                format!("{{ {material}, thickness_nm = {} }}", l.thickness_nm)
            };
            format!("[{}]", stack.layers.iter().map(layer).collect::<Vec<_>>().join(", "))
        }
        plain => text(PLAIN.iter().find(|p| p.1 == *plain).map_or("none", |p| p.0)),
    }
}
