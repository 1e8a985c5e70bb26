//! Prims composed of layers: a tree of sites each, whose arcs make them as strong as "LIVRPS" has it.
//!
//! A site is a place in a stack of layers. What arcs of a prim lead to (classes, variants, references, payloads) are sites below its own, and so are those that arcs of what is around the prim lead to,
//! with its name behind them: of one site the arcs rank by their kind, and only then by where they come from. An arc to a prim within others brings what arcs of those lead to. Classes are looked for in the layers
//! that refer to their own, too, and are stronger there; what is specialised is weaker than all else. Variants are chosen when all other arcs have been followed, by the strongest opinion.
//!
//! Source: OpenUSD, "Glossary" (LIVERPS strength ordering, list editing, instanceable) and `PcpPrimIndex`, `PcpCompareSiblingNodeStrength`. Relocates are not followed; random
//! stages in which much is inherited still differ now and then (`validation/usd_composition.py`).

use super::super::error;
use super::super::layer::{Key, Reference, TimeShift, Value, child_path, without_variants};
use super::{Read, Stage};
use std::collections::{HashMap, HashSet, VecDeque};
use std::sync::Arc;

/// Deepest that arcs lead to arcs, and prims lie within prims.
const DEEPEST: usize = 64;
const DEEPEST_PRIM: usize = 256;
/// Most opinions on one prim, and on all.
const MOST_SITES: usize = 4096;
const MOST_SITES_IN_ALL: usize = 1 << 25;
/// What is added to the number of a class that is implied: behind those that a site inherits itself.
const IMPLIED: usize = 1 << 20;

/// How a site was come to: what its paths and times are in the scene's.
#[derive(Debug)]
pub struct Link {
    /// Prim that was referred to, and the prim that refers to it, of the layers around.
    from: String,
    to: String,
    /// Whether paths elsewhere in the same layers mean what they mean there.
    same_layers: bool,
    /// Times of its own arc, and of all to the scene.
    own_shift: TimeShift,
    pub shift: TimeShift,
    /// The stack and the path that were referred to.
    target: (usize, String),
    outer: Option<Arc<Link>>,
}

impl Link {
    /// Where all begins: at the root of a stack.
    fn of_root(stack: usize) -> Link {
        Link {
            from: "/".into(),
            to: "/".into(),
            same_layers: true,
            own_shift: TimeShift::NONE,
            shift: TimeShift::NONE,
            target: (stack, "/".into()),
            outer: None,
        }
    }

    /// A path of the scene for a path of a layer, if there is one.
    pub fn scene_path(&self, path: &str) -> Option<String> {
        let (mut path, mut link) = (without_variants(path), self);
        while let Some(outer) = &link.outer {
            path = link.outwards(&path).or_else(|| link.same_layers.then(|| path.clone()))?;
            link = outer;
        }
        Some(path)
    }

    /// A path of the layers around for one below what was referred to.
    fn outwards(&self, path: &str) -> Option<String> {
        let rest = path.strip_prefix(self.from.trim_end_matches('/'))?;
        let is_below = rest.is_empty() || rest.starts_with(['/', '.']);
        is_below.then(|| format!("{}{rest}", self.to.trim_end_matches('/')))
    }

    /// Whether a target was come through already.
    fn passed(&self, stack: usize, path: &str) -> bool {
        std::iter::successors(Some(self), |l| l.outer.as_deref()).any(|l| l.target.0 == stack && l.target.1 == path)
    }

    /// The same behind another link, in place of a root.
    fn behind(link: &Arc<Link>, root: &Arc<Link>, known: &mut HashMap<*const Link, Arc<Link>>) -> Arc<Link> {
        let Some(outer) = &link.outer else { return root.clone() };
        if let Some(made) = known.get(&Arc::as_ptr(link)) {
            return made.clone();
        }
        let outer = Link::behind(outer, root, known);
        let made = Arc::new(Link {
            from: link.from.clone(),
            to: link.to.clone(),
            same_layers: link.same_layers,
            own_shift: link.own_shift,
            shift: link.own_shift.within(outer.shift),
            target: link.target.clone(),
            outer: Some(outer),
        });
        known.insert(Arc::as_ptr(link), made.clone());
        made
    }
}

/// What leads to a site, the strongest first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Kind {
    Root,
    Inherits,
    Variant,
    Reference,
    Payload,
    Specializes,
}

impl Kind {
    fn is_class(self) -> bool {
        matches!(self, Kind::Inherits | Kind::Specializes)
    }
}

/// A place in a stack of layers that may have opinions on a prim.
#[derive(Clone, Debug)]
pub struct Site {
    pub stack: usize,
    pub path: String,
    pub link: Arc<Link>,
    /// What leads here, from the site of which number, as which of its kind there, and how deep the prim lies that has the arc.
    kind: Kind,
    parent: usize,
    number: usize,
    depth: usize,
    /// Arcs from the root.
    level: usize,
    /// Whether an arc or a variant of the prim itself leads here, not of what is around it.
    is_direct: bool,
    /// Whether an inherited or specialised prim lies on the way.
    pub is_of_class: bool,
    /// Whether its opinions do not count: an instance lies around it, or another site is at the same place.
    is_muted: bool,
    /// Of a class: the site of the same class in the layers around.
    implied: Option<usize>,
}

/// A prim of the scene, or of another stack.
#[derive(Debug)]
pub struct Prim {
    pub path: String,
    /// The root first; arcs lead from earlier to later ones.
    all: Vec<Site>,
    /// Numbers of those with opinions, strongest first.
    order: Vec<usize>,
    /// Whether what is below it is the same as below others that refer to the same.
    is_instance: bool,
}

impl Prim {
    /// The sites that have opinions on it, strongest first.
    pub fn sites(&self) -> impl DoubleEndedIterator<Item = &Site> {
        self.order.iter().map(|i| &self.all[*i])
    }

    /// The sites whose opinions count below it. Of an instance those are what its own arcs lead to: overrides from around it are
    /// discarded. Source: OpenUSD, "Glossary" (Instanceable).
    pub fn sites_below(&self) -> impl DoubleEndedIterator<Item = &Site> {
        self.sites().filter(|s| s.is_direct || !self.is_instance)
    }

    /// Its own name.
    pub fn name(&self) -> &str {
        self.path.rsplit('/').next().unwrap_or_default()
    }

    /// The sites of a child, before its own arcs.
    fn of_child(&self, name: &str) -> impl Iterator<Item = Site> {
        self.all.iter().map(move |site| Site {
            path: child_path(&site.path, name),
            is_muted: site.is_muted || self.is_instance && !site.is_direct,
            is_direct: false,
            ..site.clone()
        })
    }
}

/// A prim that is being put together.
struct Composing {
    path: String,
    sites: Vec<Site>,
    /// Whether layers say something at each.
    has_specs: Vec<bool>,
    /// Sites and variant sets that have been chosen of.
    chosen: HashSet<(usize, Arc<str>)>,
    /// Classes that sites inherit or specialise, still to be followed.
    classes: Vec<(usize, Kind, Vec<Arc<str>>)>,
    /// Sites of classes that layers around may know, too.
    implying: VecDeque<usize>,
}

impl Composing {
    /// Whether a place is among the sites.
    fn holds(&self, stack: usize, path: &str) -> bool {
        self.sites.iter().any(|s| s.stack == stack && s.path == path)
    }

    /// Whether a place lies on the way to a site: it would be come to again.
    fn leads_to(&self, site: usize, stack: usize, path: &str) -> bool {
        let mut at = site;
        loop {
            let here = &self.sites[at];
            if here.stack == stack && without_variants(&here.path) == path {
                return true;
            }
            if at == here.parent {
                return self.sites[site].link.passed(stack, path);
            }
            at = here.parent;
        }
    }

    /// Takes the classes of a kind that the strongest site has.
    fn next_classes(&mut self, kind: Kind) -> Option<(usize, Vec<Arc<str>>)> {
        if !self.classes.iter().any(|c| c.1 == kind) {
            return None;
        }
        let order = self.order();
        let rank = |site: usize| order.iter().position(|i| *i == site);
        let of_kind = self.classes.iter().enumerate().filter(|(_, c)| c.1 == kind);
        let (next, _) = of_kind.min_by_key(|(_, c)| rank(c.0).unwrap_or(usize::MAX))?;
        let (site, _, classes) = self.classes.remove(next);
        Some((site, classes))
    }

    /// Takes a site of a class that is still to be looked for in the layers around.
    fn next_implying(&mut self, kind: Kind) -> Option<usize> {
        let next = self.implying.iter().position(|i| self.sites[*i].kind == kind)?;
        self.implying.remove(next)
    }

    /// Numbers of the sites with opinions, strongest first.
    fn order(&self) -> Vec<usize> {
        let mut below: Vec<Vec<usize>> = vec![vec![]; self.sites.len()];
        for (i, site) in self.sites.iter().enumerate().skip(1) {
            below[site.parent].push(i);
        }
        for list in &mut below {
            let rank = |i: &usize| {
                let site = &self.sites[*i];
                // What is nearer to the prim is stronger.
                (site.kind, std::cmp::Reverse(site.depth), site.number)
            };
            list.sort_by_key(rank);
        }
        let mut order = Vec::with_capacity(self.sites.len());
        // What is specialised comes behind all else, what the outer layers specialise first.
        let mut weakest = vec![0];
        while !weakest.is_empty() {
            weakest.sort_by_key(|i| self.sites[*i].level);
            let mut later = Vec::new();
            for first in weakest {
                let mut open = vec![first];
                while let Some(i) = open.pop() {
                    if self.has_specs[i] && !self.sites[i].is_muted {
                        order.push(i);
                    }
                    let (specialised, others): (Vec<usize>, Vec<usize>) =
                        below[i].iter().partition(|k| self.sites[**k].kind == Kind::Specializes);
                    later.extend(specialised);
                    open.extend(others.into_iter().rev());
                }
            }
            weakest = later;
        }
        order
    }

    /// The prim, without sites of which nothing is said, nor of what lies below them.
    fn finished(mut self) -> Option<Prim> {
        let mut is_kept = self.has_specs.clone();
        for i in (1..is_kept.len()).rev() {
            let parent = self.sites[i].parent;
            is_kept[parent] |= is_kept[i];
        }
        is_kept[0] = true;
        let mut new_number = vec![None; is_kept.len()];
        for (number, (i, _)) in is_kept.iter().enumerate().filter(|(_, kept)| **kept).enumerate() {
            new_number[i] = Some(number);
        }
        let order: Vec<usize> = self.order().into_iter().filter_map(|i| new_number[i]).collect();
        if order.is_empty() {
            return None;
        }
        for site in &mut self.sites {
            site.parent = new_number[site.parent].unwrap_or(0);
            site.implied = site.implied.and_then(|i| new_number[i]);
        }
        let mut kept = is_kept.iter();
        self.sites.retain(|_| kept.next().is_some_and(|k| *k));
        Some(Prim { path: self.path, all: self.sites, order, is_instance: false })
    }
}

/// A reference or payload, and what tells it from others in lists that several layers edit: the file that is meant, the prim there, and the times.
#[derive(Clone, Debug)]
struct Referring {
    file: String,
    reference: Reference,
    /// The layer that says it, and its times.
    layer: usize,
    shift: TimeShift,
}

impl PartialEq for Referring {
    fn eq(&self, other: &Self) -> bool {
        let told = |r: &Referring| (r.reference.prim.clone(), r.reference.shift);
        self.file == other.file && told(self) == told(other)
    }
}

/// An arc to follow.
struct Way {
    kind: Kind,
    number: usize,
    stack: usize,
    path: String,
    shift: TimeShift,
}

impl Stage<'_> {
    /// The prim of a path of the scene, if anything is said of it.
    pub fn prim(&mut self, path: &str) -> Read<Option<Arc<Prim>>> {
        self.prim_of(0, path)
    }

    /// The children of a prim, in the order of the weakest layer that names them.
    pub fn children(&mut self, prim: &Prim) -> Read<Vec<Arc<Prim>>> {
        let mut names: Vec<Arc<str>> = Vec::new();
        let mut known = HashSet::new();
        for site in prim.sites_below().rev() {
            for (layer, _) in self.stacks[site.stack].layers.iter().rev() {
                if let Some(Value::Texts(list)) = self.layers[*layer].get(&site.path, Key::PrimChildren)? {
                    // In damaged files a name can be a path: of the prim itself, for one.
                    let names_child = |n: &str| !n.is_empty() && !n.contains(['/', '.', '{']);
                    names.extend(list.iter().filter(|n| names_child(n) && known.insert((*n).clone())).cloned());
                }
            }
        }
        let mut all = Vec::with_capacity(names.len());
        for name in names {
            all.extend(self.prim(&child_path(&prim.path, &name))?);
        }
        Ok(all)
    }

    /// The prim of a path of a stack, as if that were the scene.
    fn prim_of(&mut self, stack: usize, path: &str) -> Read<Option<Arc<Prim>>> {
        let key = (stack, path.to_owned());
        if let Some(known) = self.prims.get(&key) {
            return Ok(known.clone());
        }
        let name = &self.layers[self.stacks[stack].layers[0].0].name;
        if path.matches('/').count() > DEEPEST_PRIM {
            let found = format!("prims within prims, more than {DEEPEST_PRIM} deep");
            return Err(error(name, found, "fewer levels: does a prim refer to one that holds it?"));
        }
        if path == "/" {
            let root = Arc::new(Prim { path: "/".into(), all: vec![root_of(stack)], order: vec![0], is_instance: false });
            self.prims.insert(key, Some(root.clone()));
            return Ok(Some(root));
        }
        let Some((parent, child)) = path.rsplit_once('/').filter(|(_, name)| !name.is_empty()) else { return Ok(None) };
        if !self.composing.insert(key.clone()) {
            return Err(goes_round(name, path, path));
        }
        let made = match self.prim_of(stack, if parent.is_empty() { "/" } else { parent })? {
            Some(parent) => self.composed(&parent, child)?,
            None => None,
        };
        self.composing.remove(&key);
        self.prims.insert(key, made.clone());
        Ok(made)
    }

    fn composed(&mut self, parent: &Prim, name: &str) -> Read<Option<Arc<Prim>>> {
        let mut found = Composing {
            path: child_path(&parent.path, name),
            sites: Vec::with_capacity(parent.all.len()),
            has_specs: vec![],
            chosen: HashSet::new(),
            classes: vec![],
            implying: VecDeque::new(),
        };
        for site in parent.of_child(name) {
            self.push(&mut found, site)?;
        }
        // References of all sites first, then what they inherit, what is implied by that, what they specialise, and last variants: a class that is there already is not added again.
        let mut next = 0;
        'all: loop {
            while next < found.sites.len() {
                self.follow_references(&mut found, next)?;
                next += 1;
            }
            for kind in [Kind::Inherits, Kind::Specializes] {
                if let Some((at, classes)) = found.next_classes(kind) {
                    self.follow_classes(&mut found, at, kind, &classes)?;
                    continue 'all;
                }
                if let Some(class) = found.next_implying(kind) {
                    self.imply(&mut found, class)?;
                    continue 'all;
                }
            }
            if !self.choose_variant(&mut found)? {
                break;
            }
        }
        let path = found.path.clone();
        let Some(mut prim) = found.finished() else { return Ok(None) };
        self.sites += prim.all.len();
        if self.sites > MOST_SITES_IN_ALL {
            let expected = "fewer: do references repeat each other?";
            return Err(error(&path, format!("more than {MOST_SITES_IN_ALL} opinions in all"), expected));
        }
        prim.is_instance = prim.sites().any(|s| s.is_direct)
            && self.field(&prim, Key::Instanceable)?.and_then(|v| v.number()).is_some_and(|v| v != 0.0);
        Ok(Some(Arc::new(prim)))
    }

    /// Adds a site. Fails where there are too many.
    fn push(&self, found: &mut Composing, site: Site) -> Read<()> {
        if found.sites.len() >= MOST_SITES || site.level > DEEPEST {
            let expected = "fewer: does something refer to itself?";
            return Err(error(&found.path, format!("references to references, more than {DEEPEST} deep"), expected));
        }
        let layers = &self.stacks[site.stack].layers;
        found.has_specs.push(layers.iter().any(|(l, _)| self.layers[*l].specs.contains_key(site.path.as_str())));
        found.sites.push(site);
        Ok(())
    }

    /// Adds what the references and payloads of a site lead to, and notes its classes.
    fn follow_references(&mut self, found: &mut Composing, at: usize) -> Read<()> {
        let site = &found.sites[at];
        if !found.has_specs[at] || site.is_muted {
            return Ok(());
        }
        let (stack, path) = (site.stack, site.path.clone());
        let layers = self.stacks[stack].layers.clone();
        let (mut inherits, mut specializes) = (vec![], vec![]);
        let (mut references, mut payloads): (Vec<Referring>, Vec<Referring>) = (vec![], vec![]);
        // Weakest first: each layer edits what is below.
        for (layer, shift) in layers.into_iter().rev() {
            for (key, list) in [(Key::InheritPaths, &mut inherits), (Key::Specializes, &mut specializes)] {
                if let Some(Value::List(edits)) = self.layers[layer].get(&path, key)? {
                    edits.apply(list);
                }
            }
            for (key, list) in [(Key::References, &mut references), (Key::Payload, &mut payloads)] {
                if let Some(Value::References(edits)) = self.layers[layer].get(&path, key)? {
                    let here = |r: &Reference| {
                        let file = if r.asset.is_empty() { String::new() } else { self.file_key(layer, &r.asset) };
                        Some(Referring { file, reference: r.clone(), layer, shift })
                    };
                    edits.map(here).apply(list);
                }
            }
        }
        let classes = [(Kind::Inherits, inherits), (Kind::Specializes, specializes)];
        found.classes.extend(classes.into_iter().filter(|c| !c.1.is_empty()).map(|(kind, list)| (at, kind, list)));
        for (kind, list) in [(Kind::Reference, references), (Kind::Payload, payloads)] {
            for (number, referring) in list.iter().enumerate() {
                if let Some((stack, path, shift)) = self.target(stack, referring)? {
                    self.enter(found, at, Way { kind, number, stack, path, shift })?;
                }
            }
        }
        Ok(())
    }

    /// Adds the classes of a site that are not there yet.
    fn follow_classes(&mut self, found: &mut Composing, at: usize, kind: Kind, classes: &[Arc<str>]) -> Read<()> {
        let stack = found.sites[at].stack;
        for (number, class) in classes.iter().enumerate() {
            let path = without_variants(class);
            if found.leads_to(at, stack, &path) || !found.holds(stack, &path) {
                self.enter(found, at, Way { kind, number, stack, path, shift: TimeShift::NONE })?;
            }
        }
        Ok(())
    }

    /// Stack, path and times of what a reference in a stack leads to; `None`, which is noted, where that cannot be had.
    fn target(&mut self, own: usize, referring: &Referring) -> Read<Option<(usize, String, TimeShift)>> {
        let (to, layer) = (&referring.reference, referring.layer);
        let shift = to.shift.within(referring.shift);
        let stack = match to.asset.is_empty() {
            true => own,
            false => match self.open(layer, &to.asset)? {
                Some(stack) => stack,
                None => return Ok(None),
            },
        };
        let first = self.stacks[stack].layers[0].0;
        let path = match to.prim.is_empty() {
            true => self.default_prim(first)?,
            false => Some(without_variants(&to.prim)),
        };
        let Some(path) = path else {
            let missing = format!("{} (it has no default prim)", to.asset);
            if !to.asset.is_empty() && !self.missing.contains(&missing) {
                self.missing.push(missing);
            }
            return Ok(None);
        };
        let shift = match to.asset.is_empty() {
            true => shift,
            false => shift.of_longer_codes(self.codes_in_one(layer, first)?),
        };
        Ok(Some((stack, path, shift)))
    }

    /// Adds what an arc leads to, with what the arcs of prims around that lead to.
    fn enter(&mut self, found: &mut Composing, at: usize, way: Way) -> Read<()> {
        let Way { kind, number, stack, path, shift } = way;
        let site = &found.sites[at];
        if found.leads_to(at, stack, &path) {
            return Err(goes_round(&self.layers[self.stacks[stack].layers[0].0].name, &path, &site.path));
        }
        let to = without_variants(&site.path);
        let link = Arc::new(Link {
            from: path.clone(),
            same_layers: stack == site.stack,
            own_shift: shift,
            shift: shift.within(site.link.shift),
            target: (stack, path.clone()),
            outer: Some(site.link.clone()),
            to: to.clone(),
        });
        let top = Site {
            stack,
            path: path.clone(),
            link: link.clone(),
            kind,
            parent: at,
            number,
            depth: to.matches('/').count(),
            level: site.level + 1,
            is_direct: true,
            is_of_class: site.is_of_class || kind.is_class(),
            is_muted: false,
            implied: None,
        };
        let base = found.sites.len();
        let around = match path.rsplit_once('/') {
            Some((parent, child)) if !parent.is_empty() && !child.is_empty() => self.prim_of(stack, parent)?.map(|p| (p, child)),
            _ => None,
        };
        match around {
            None => self.push(found, top)?,
            Some((parent, child)) => {
                let (level, is_of_class) = (top.level, top.is_of_class);
                self.push(found, top)?;
                let mut known = HashMap::new();
                for site in parent.of_child(child).skip(1) {
                    let moved = Site {
                        link: Link::behind(&site.link, &link, &mut known),
                        parent: base + site.parent,
                        level: level + site.level,
                        is_direct: true,
                        is_of_class: is_of_class || site.is_of_class,
                        implied: site.implied.map(|i| base + i),
                        ..site
                    };
                    self.push(found, moved)?;
                }
            }
        }
        for added in base..found.sites.len() {
            if found.sites[added].kind.is_class() && found.sites[added].implied.is_none() {
                found.implying.push_back(added);
            }
        }
        Ok(())
    }

    /// Adds the same class as the layers around know it that refer to those of a site.
    fn imply(&mut self, found: &mut Composing, class: usize) -> Read<()> {
        let mut class = class;
        loop {
            let from = found.sites[class].parent;
            // The arc that leads from the layers around into those of the class.
            let mut across = from;
            while matches!(found.sites[across].kind, Kind::Variant | Kind::Inherits | Kind::Specializes) {
                across = found.sites[across].parent;
            }
            if found.sites[across].kind == Kind::Root {
                return Ok(());
            }
            let at = match found.sites[from].kind.is_class() {
                true => found.sites[from].implied,
                false => Some(found.sites[across].parent),
            };
            let Some(at) = at else { return Ok(()) };
            let (here, around) = (&found.sites[class], &found.sites[at]);
            let own = without_variants(&here.path);
            // Found under the same name where it lies outside of what is referred to.
            let path = found.sites[across].link.outwards(&own).unwrap_or_else(|| own.clone());
            let kind = here.kind;
            let is_there = |s: &Site| s.parent == at && s.kind == kind && s.stack == around.stack && s.path == path;
            if let Some(there) = found.sites.iter().position(is_there) {
                found.sites[class].implied = Some(there);
                return Ok(());
            }
            let is_same = around.stack == here.stack && path == own;
            let goes_round = around.link.passed(around.stack, &path) || without_variants(&around.path) == path;
            if goes_round || !is_same && found.holds(around.stack, &path) {
                return Ok(());
            }
            let link = Link {
                from: path.clone(),
                to: without_variants(&around.path),
                same_layers: true,
                own_shift: TimeShift::NONE,
                shift: around.link.shift,
                target: (around.stack, path.clone()),
                outer: Some(around.link.clone()),
            };
            let site = Site {
                stack: around.stack,
                link: Arc::new(link),
                kind,
                parent: at,
                number: here.number + IMPLIED,
                depth: here.depth.min(without_variants(&around.path).matches('/').count()),
                level: around.level + 1,
                is_direct: here.is_direct,
                is_of_class: true,
                is_muted: is_same,
                implied: None,
                path,
            };
            let added = found.sites.len();
            self.push(found, site)?;
            found.sites[class].implied = Some(added);
            class = added;
        }
    }

    /// Adds the variant that is chosen of the first set of which none has been yet, in the order of strength. Whether there was one.
    fn choose_variant(&mut self, found: &mut Composing) -> Read<bool> {
        let order = found.order();
        for at in &order {
            let site = &found.sites[*at];
            let layers = &self.stacks[site.stack].layers;
            let mut sets: Vec<Arc<str>> = vec![];
            for (layer, _) in layers.iter().rev() {
                if let Some(Value::List(edits)) = self.layers[*layer].get(&site.path, Key::VariantSetNames)? {
                    edits.apply(&mut sets);
                }
            }
            for (number, set) in sets.into_iter().enumerate() {
                if found.chosen.contains(&(*at, set.clone())) {
                    continue;
                }
                let Some(variant) = self.selection(found, &order, &set)? else { continue };
                found.chosen.insert((*at, set.clone()));
                if variant.is_empty() {
                    continue;
                }
                let site = &found.sites[*at];
                let chosen = Site {
                    path: format!("{}{{{set}={variant}}}", site.path),
                    kind: Kind::Variant,
                    parent: *at,
                    number,
                    depth: without_variants(&site.path).matches('/').count(),
                    level: site.level + 1,
                    is_direct: true,
                    implied: None,
                    ..site.clone()
                };
                self.push(found, chosen)?;
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// What the strongest opinion chooses of a variant set.
    fn selection(&self, found: &Composing, order: &[usize], set: &str) -> Read<Option<Arc<str>>> {
        for site in order.iter().map(|i| &found.sites[*i]) {
            for (layer, _) in &self.stacks[site.stack].layers {
                if let Some(Value::Selections(all)) = self.layers[*layer].get(&site.path, Key::VariantSelection)?
                    && let Some((_, variant)) = all.iter().find(|(name, _)| **name == *set)
                {
                    return Ok(Some(variant.clone()));
                }
            }
        }
        Ok(None)
    }

    fn default_prim(&self, layer: usize) -> Read<Option<String>> {
        let name = self.layers[layer].get("/", Key::DefaultPrim)?;
        Ok(name.as_ref().and_then(Value::text).map(|n| if n.starts_with('/') { n.to_string() } else { format!("/{n}") }))
    }
}

/// The root of a stack.
fn root_of(stack: usize) -> Site {
    Site {
        stack,
        path: "/".into(),
        link: Arc::new(Link::of_root(stack)),
        kind: Kind::Root,
        parent: 0,
        number: 0,
        depth: 0,
        level: 0,
        is_direct: false,
        is_of_class: false,
        is_muted: false,
        implied: None,
    }
}

fn goes_round(name: &str, path: &str, by: &str) -> crate::SceneError {
    let found = format!("{path} refers to itself, by way of {by}");
    error(name, found, "references, payloads and inherits that do not go round")
}
