//! The rows of a study before their scenes are looked at: the product of the axes and the rows by themselves.
use super::plan::MAX_ROWS;
use super::read::{StudyFile, at};
use super::schema::{EntrySpec, Sets};
use crate::scene::error::{Problem, SceneErrors};
use crate::scene::spans::Path;
use std::collections::BTreeSet;

/// A row before its scene was looked at, with the places of its parts in the study file.
pub(super) struct Draft {
    pub labels: Vec<String>,
    pub scene: Option<(Path, String)>,
    pub sets: Vec<(Path, (String, String))>,
    pub place: Path,
}

impl Draft {
    fn add(&mut self, place: &Path, scene: &Option<String>, sets: &Sets) {
        if let Some(scene) = scene {
            self.scene = Some((place.key("scene"), scene.clone()));
        }
        self.sets.extend(sets.0.iter().map(|(p, v)| (place.key("set").key(p), (p.clone(), v.clone()))));
    }
}

/// All rows: those of the axes, the last axis fastest, then those by themselves.
pub(super) fn drafts(file: &StudyFile) -> Result<Vec<Draft>, SceneErrors> {
    let study = &file.study;
    let product = study.axes.iter().try_fold(usize::from(!study.axes.is_empty()), |n, a| n.checked_mul(a.points.len()));
    if product.is_none_or(|n| n > MAX_ROWS) || study.rows.len() > MAX_ROWS {
        return Err(file.errors(vec![Problem::new(at("axes"), format!("the study has more than {MAX_ROWS} rows"))]));
    }
    let new = |place: Path| {
        let scene = study.scene.clone().map(|s| (at("scene"), s));
        let sets = study.set.0.iter().map(|(p, v)| (at("set").key(p), (p.clone(), v.clone())));
        Draft { labels: Vec::new(), scene, sets: sets.collect(), place }
    };
    let mut drafts = Vec::new();
    for i in 0..product.unwrap_or(0) {
        let mut draft = new(at("axes"));
        // The digits of i in the mixed base of the axes.
        let mut rest = i;
        let mut digits: Vec<usize> = Vec::new();
        for axis in study.axes.iter().rev() {
            digits.push(rest % axis.points.len());
            rest /= axis.points.len();
        }
        for (k, (axis, j)) in study.axes.iter().zip(digits.into_iter().rev()).enumerate() {
            let EntrySpec { label, scene, set } = &axis.points[j];
            let place = at("axes").index(k).key("points").index(j);
            draft.labels.push(label.clone());
            draft.add(&place, scene, set);
            draft.place = place;
        }
        drafts.push(draft);
    }
    for (i, r) in study.rows.iter().enumerate() {
        let place = at("rows").index(i);
        let mut draft = new(place.clone());
        draft.labels.push(r.label.clone());
        draft.add(&place, &r.scene, &r.set);
        drafts.push(draft);
    }
    Ok(drafts)
}

/// Folder names: labels with what file systems do not like replaced, counted where they are equal.
pub(super) fn names(drafts: &[Draft]) -> Vec<String> {
    let plain = |c: char| if c.is_alphanumeric() || "_+.=".contains(c) { c } else { '_' };
    let mut used = BTreeSet::new();
    let name = |draft: &Draft| {
        let text = draft.labels.iter().map(|l| l.trim().chars().map(plain).collect::<String>()).collect::<Vec<_>>().join("-");
        // No hidden folders, none that mean another one, and no names that are too long.
        let text: String = text.trim_start_matches('.').chars().take(80).collect();
        let text = if text.is_empty() { "row".to_owned() } else { text };
        let all = std::iter::once(text.clone()).chain((2..).map(|i| format!("{text}-{i}")));
        // File systems may not tell `A` from `a`.
        all.into_iter().find(|n| used.insert(n.to_lowercase())).expect("some number is free")
    };
    drafts.iter().map(name).collect()
}
