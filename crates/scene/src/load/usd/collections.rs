//! Collections of prims, and which material prims are bound to, directly or as one of a collection.
//!
//! Source: OpenUSD, `UsdCollectionAPI` (includes, excludes, expansion rules) and `UsdShadeMaterialBindingAPI` (`ComputeBoundMaterial`: of a purpose, of the prim and of
//! what is around it the nearest binding counts, unless one further out is stronger than descendants; on one prim a collection's goes before its own).
//! Collections by path expressions are not read.

use super::layer::{Key, Value};
use super::stage::{Prim, Stage};
use crate::SceneError;
use std::collections::HashSet;
use std::sync::Arc;

/// Deepest that collections lie in collections, and most that one is made of: they may include each other.
const DEEPEST: usize = 16;
const MOST: usize = 4096;

type Read<T> = Result<T, SceneError>;

/// Prims by their paths.
#[derive(Debug, Default)]
pub(super) struct Collection {
    includes: HashSet<String>,
    excludes: HashSet<String>,
    /// Whether what is below the prims that are named is not in it.
    is_explicit: bool,
    holds_root: bool,
    inner: Vec<Collection>,
}

impl Collection {
    /// Whether a prim is in it: the nearest prim above it that is named counts.
    pub fn holds(&self, path: &str) -> bool {
        let mut at = path;
        while !at.is_empty() {
            if self.excludes.contains(at) {
                return false;
            }
            if self.includes.contains(at) && (at == path || !self.is_explicit) {
                return true;
            }
            at = at.rsplit_once('/').map_or("", |(parent, _)| parent);
        }
        self.holds_root && !self.is_explicit || self.inner.iter().any(|c| c.holds(path))
    }
}

/// A material, and whether it is stronger than those of descendants.
pub(super) type Binding = (String, bool);

/// What a prim binds itself and all below it to, and what is around it.
#[derive(Debug)]
pub(super) struct Bindings {
    /// By [`PURPOSES`].
    of_purpose: [OfPurpose; 3],
    outer: Option<Arc<Bindings>>,
}

/// What a prim binds for a purpose.
#[derive(Debug, Default)]
struct OfPurpose {
    direct: Option<Binding>,
    collections: Vec<(Collection, Binding)>,
}

/// Purposes of materials, each of which counts only where nothing around is bound for those before: the final picture, all, previews.
const PURPOSES: [&str; 3] = ["material:binding:full", "material:binding", "material:binding:preview"];

/// The material that a prim of a path is bound to.
pub(super) fn material<'a>(bindings: Option<&'a Arc<Bindings>>, path: &str) -> Option<&'a str> {
    (0..PURPOSES.len()).find_map(|purpose| material_for(bindings, path, purpose))
}

fn material_for<'a>(bindings: Option<&'a Arc<Bindings>>, path: &str, purpose: usize) -> Option<&'a str> {
    let mut found: Option<&Binding> = None;
    for level in std::iter::successors(bindings, |b| b.outer.as_ref()) {
        let level = &level.of_purpose[purpose];
        let mut is_own = false;
        if let Some(direct) = level.direct.as_ref().filter(|d| found.is_none() || d.1) {
            (found, is_own) = (Some(direct), true);
        }
        if let Some((_, bound)) = level.collections.iter().find(|(collection, _)| collection.holds(path))
            && (found.is_none() || is_own || bound.1)
        {
            found = Some(bound);
        }
    }
    found.map(|(material, _)| material.as_str())
}

/// Bindings of a prim within others, and whether it has some to collections by path expressions, which are left out. Fails where a value is damaged in its file.
pub(super) fn bindings(stage: &mut Stage, prim: &Prim, outer: Option<Arc<Bindings>>) -> Read<(Option<Arc<Bindings>>, bool)> {
    let mut of_purpose: [OfPurpose; 3] = Default::default();
    for (of_purpose, name) in of_purpose.iter_mut().zip(PURPOSES) {
        if let Some(path) = stage.targets(prim, name, Key::TargetPaths)?.into_iter().next() {
            of_purpose.direct = Some((path, is_strong(stage, prim, name)?));
        }
    }
    let (mut has_expressions, mut left) = (false, MOST);
    for name in stage.collection_bindings(prim) {
        let purpose = match name.split(':').collect::<Vec<_>>()[..] {
            [_, _, _, "full", _, ..] => 0,
            [_, _, _, "preview", _, ..] => 2,
            _ => 1,
        };
        let targets = stage.targets(prim, &name, Key::TargetPaths)?;
        let (of, materials): (Vec<String>, Vec<String>) = targets.into_iter().partition(|t| t.contains(".collection:"));
        let (Some(of), Some(path)) = (of.first(), materials.into_iter().next()) else { continue };
        match read(stage, of, DEEPEST, &mut left)? {
            Some(collection) => {
                let binding = (path, is_strong(stage, prim, &name)?);
                of_purpose[purpose].collections.push((collection, binding));
            }
            None => has_expressions = true,
        }
    }
    if of_purpose.iter().all(|p| p.direct.is_none() && p.collections.is_empty()) {
        return Ok((outer, has_expressions));
    }
    Ok((Some(Arc::new(Bindings { of_purpose, outer })), has_expressions))
}

fn is_strong(stage: &Stage, prim: &Prim, name: &str) -> Read<bool> {
    let strength = stage.property_field(prim, name, Key::BindMaterialAs)?;
    Ok(strength.as_ref().and_then(Value::text).is_some_and(|t| &**t == "strongerThanDescendants"))
}

/// The collection at a path: "/A.collection:red"; `None` of one by a path expression. Beyond a depth, and when `left` are read, it holds nothing.
fn read(stage: &mut Stage, path: &str, deepest: usize, left: &mut usize) -> Read<Option<Collection>> {
    if deepest == 0 || *left == 0 {
        return Ok(Some(Collection::default()));
    }
    *left -= 1;
    let Some((prim, name)) = path.split_once('.') else { return Ok(None) };
    let Some(prim) = stage.prim(prim)? else { return Ok(Some(Collection::default())) };
    let includes = stage.targets(&prim, &format!("{name}:includes"), Key::TargetPaths)?;
    let excludes = stage.targets(&prim, &format!("{name}:excludes"), Key::TargetPaths)?;
    let holds_root = stage.value(&prim, &format!("{name}:includeRoot"))?.and_then(|v| v.number()).is_some_and(|v| v != 0.0);
    if includes.is_empty() && !holds_root && stage.attribute(&prim, &format!("{name}:membershipExpression"))?.is_some() {
        return Ok(None);
    }
    let rule = stage.value(&prim, &format!("{name}:expansionRule"))?;
    let is_explicit = rule.as_ref().and_then(Value::text).is_some_and(|r| &**r == "explicitOnly");
    let (inner, includes): (Vec<String>, Vec<String>) = includes.into_iter().partition(|t| t.contains(".collection:"));
    let mut all = Collection {
        includes: includes.into_iter().collect(),
        excludes: excludes.into_iter().collect(),
        is_explicit,
        holds_root,
        inner: vec![],
    };
    for path in &inner {
        match read(stage, path, deepest - 1, left)? {
            Some(collection) => all.inner.push(collection),
            None => return Ok(None),
        }
    }
    Ok(Some(all))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_prim_that_is_named_says_whether_a_collection_holds_another() {
        let set = |list: &[&str]| list.iter().map(|p| (*p).to_owned()).collect::<HashSet<String>>();
        let mut c = Collection { includes: set(&["/A", "/A/B/C"]), excludes: set(&["/A/B"]), ..Collection::default() };
        for (path, holds) in [
            ("/A", true),
            ("/A/X/Y", true),
            ("/A/B", false),
            ("/A/B/D", false),
            ("/A/B/C/E", true),
            ("/AA", false),
            ("/Z", false),
        ] {
            assert_eq!(c.holds(path), holds, "{path}");
        }
        c.is_explicit = true;
        assert!(c.holds("/A") && !c.holds("/A/X") && c.holds("/A/B/C"));
        let outer = Collection { inner: vec![c], excludes: set(&["/A/B"]), ..Collection::default() };
        assert!(outer.holds("/A") && !outer.holds("/A/B/C"));
    }
}
