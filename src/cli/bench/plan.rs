//! What is measured: every value of every list with every other.

use std::collections::HashSet;
use std::fs;

use anyhow::{Context, Result};

use surfel::structure::Arrangement;
use surfel::style::{Ellipse, Front, Interval, Style, SumPrecision, Tolerance, Voronoi};
use surfel::technique::{Blend, PRESETS, Selection, Structure, Technique};

use super::super::Usage;
use super::super::camera::Pose;
use super::super::parse::Input;
use super::args::{SweepArgs, Views};
use super::record::Combination;

/// A combination with what draws it.
pub struct Way {
    pub combination: Combination,
    pub technique: Technique,
    pub style: Style,
    pub form: Form,
}

/// How the points are arranged for it: ways of one form share the device's copy.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Form {
    /// c of the groups, where there are any.
    pub factor: Option<f32>,
    pub storage: Arrangement,
    pub structure: Structure,
}

/// What an input is called in results.
pub fn name(input: &Input) -> String {
    match input {
        Input::File(path) => path.file_name().unwrap_or_default().to_string_lossy().into_owned(),
        Input::Remote(address) => address.clone(),
        Input::Scene { name, points, seed } => format!("scene:{name}:{points}:{seed}"),
    }
}

/// Results tell inputs apart by their names alone.
pub fn distinct(inputs: &[Input]) -> Result<(), Usage> {
    let mut known = HashSet::new();
    match inputs.iter().map(name).find(|name| !known.insert(name.clone())) {
        Some(name) => Err(Usage(format!("two inputs are called {name}: their results could not be told apart"))),
        None => Ok(()),
    }
}

/// What changes with an input's content.
pub fn state(input: &Input) -> Result<String> {
    let Input::File(path) = input else { return Ok("made".into()) };
    let about = fs::metadata(path).with_context(|| path.display().to_string())?;
    let time = about.modified().ok().and_then(|t| t.duration_since(std::time::UNIX_EPOCH).ok());
    Ok(format!("{} bytes, time {}", about.len(), time.map_or(0, |t| t.as_nanos())))
}

pub fn samples(args: &SweepArgs) -> Vec<Option<u32>> {
    match args.samples.is_empty() {
        true => vec![None],
        false => args.samples.iter().copied().map(Some).collect(),
    }
}

/// As named, else from all sides, in turn a little, well and steeply from above.
pub fn pose(number: u32, views: &Views) -> Pose {
    match views {
        Views::Named(names) => Pose::Named(names[number as usize]),
        Views::Around(n) => {
            let azimuth = 30.0 + 360.0 * number as f64 / *n as f64;
            Pose::Framed { azimuth, elevation: [15.0, 35.0, 60.0][number as usize % 3] }
        }
    }
}

/// Every combination for one input, each once.
pub fn plan(args: &SweepArgs, input: &str, state: &str) -> Vec<Combination> {
    let wanted = |t: &Technique| args.techniques.is_empty() || args.techniques.contains(t);
    let tolerances = if args.tolerances.is_empty() { vec![args.look.tolerance] } else { args.tolerances.clone() };
    let mut plan: Vec<Combination> = Vec::new();
    let mut known = HashSet::new();
    let mut add = |combination: Combination| {
        if known.insert(combination.key()) {
            plan.push(combination);
        }
    };
    let choices = [
        args.ellipses.len(),
        args.scales.len(),
        args.sums.len(),
        tolerances.len(),
        args.fronts.len(),
        args.voronois.len(),
        args.factors.len(),
        args.storages.len(),
        args.structures.len(),
        args.thresholds.len(),
        args.selections.len(),
        args.intervals.len(),
    ];
    let places = args.sizes.iter().flat_map(|&size| samples(args).into_iter().map(move |samples| (size, samples)));
    for (size, samples) in places {
        for view in 0..args.views.len() {
            for (name, technique) in PRESETS.iter().filter(|(_, t)| wanted(t)) {
                let [fuzzy, groups] = [Blend::Fuzzy, Blend::Groups].map(|b| technique.blend == b);
                for [
                    ellipse,
                    scale,
                    sums,
                    tolerance,
                    front,
                    voronoi,
                    factor,
                    storage,
                    structure,
                    threshold,
                    selection,
                    interval,
                ] in indices(choices)
                {
                    let structure = args.structures[structure];
                    let flat = structure == Structure::Flat;
                    let tested = matches!(
                        structure,
                        Structure::Sequential | Structure::Hybrid | Structure::OneSpt | Structure::SptR
                    );
                    add(Combination {
                        input: input.to_owned(),
                        input_state: state.to_owned(),
                        samples,
                        technique: (*name).to_owned(),
                        ellipse: args.ellipses[ellipse].name().to_owned(),
                        scale: args.scales[scale],
                        // `opaque` has none.
                        tolerance: if technique.blend == Blend::Opaque { 1.0 } else { tolerances[tolerance] },
                        sums: args.sums[sums].name().to_owned(),
                        front: fuzzy.then(|| args.fronts[front].name().to_owned()),
                        voronoi: groups.then(|| args.voronois[voronoi].name().to_owned()),
                        factor: groups.then(|| args.factors[factor]),
                        // Other structures have an order of their own.
                        storage: if flat { args.storages[storage] } else { Arrangement::AsRead }.name().to_owned(),
                        structure: structure.name().to_owned(),
                        threshold: (!flat).then(|| args.thresholds[threshold]),
                        selection: tested.then(|| args.selections[selection].name().to_owned()),
                        interval: tested.then(|| args.intervals[interval].name().to_owned()),
                        view: [view, args.views.len()],
                        view_name: args.views.name(view),
                        size,
                    });
                }
            }
        }
    }
    plan
}

/// Every combination of indices below these lengths, the last one fastest.
fn indices<const N: usize>(lengths: [usize; N]) -> Vec<[usize; N]> {
    lengths.iter().enumerate().fold(vec![[0; N]], |all, (axis, &length)| {
        let longer = |at: [usize; N]| {
            (0..length).map(move |i| {
                let mut at = at;
                at[axis] = i;
                at
            })
        };
        all.into_iter().flat_map(longer).collect()
    })
}

/// What draws a combination.
pub fn way(combination: &Combination, style: &Style) -> Result<Way> {
    let other = "a name of another version";
    let front = combination.front.as_deref().map(|name| Front::named(name).context(other)).transpose()?;
    let voronoi = combination.voronoi.as_deref().map(|name| Voronoi::named(name).context(other)).transpose()?;
    let interval = combination.interval.as_deref().map(|name| Interval::named(name).context(other)).transpose()?;
    let selection = combination.selection.as_deref().map(|name| Selection::named(name).context(other)).transpose()?;
    let style = Style {
        ellipse: Ellipse::named(&combination.ellipse).context(other)?,
        sums: SumPrecision::named(&combination.sums).context(other)?,
        radius_scale: combination.scale as f32,
        tolerance: Tolerance { absolute: 0.0, relative: combination.tolerance as f32 },
        front: front.unwrap_or(style.front),
        voronoi: voronoi.unwrap_or(style.voronoi),
        threshold: combination.threshold.map_or(style.threshold, |px| px as f32),
        interval: interval.unwrap_or(style.interval),
        ..*style
    };
    let preset = Technique::named(&combination.technique).context(other)?;
    let structure = Structure::named(&combination.structure).context(other)?;
    let technique = Technique { structure, selection: selection.unwrap_or(preset.selection), ..preset };
    let storage = Arrangement::named(&combination.storage).context(other)?;
    let form = Form { factor: combination.factor, storage, structure };
    Ok(Way { combination: combination.clone(), technique, style, form })
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::super::super::args::{Cli, Command};
    use super::*;

    fn sweep(more: &str) -> SweepArgs {
        let line = "surfel bench a.ply -o out".split(' ').chain(more.split_whitespace());
        match Cli::try_parse_from(line).unwrap().command {
            Command::Bench(args) => args.sweep,
            _ => unreachable!("it says bench"),
        }
    }

    #[test]
    fn everything_is_combined_once() {
        let keys = |more: &str| plan(&sweep(more), "a", "s").iter().map(Combination::key).collect::<Vec<_>>();
        assert_eq!(keys("").len(), PRESETS.len() * 3);
        let one = "--techniques flat.two-pass.point --views 1";
        assert_eq!(keys(one).len(), 1);
        let all = format!(
            "{one} --ellipses exact,approximate --scales 0.5,1,2 --sums single,half --tolerances 1,2 --sizes 8x8,9x9 --samples 5,6"
        );
        let mut found = keys(&all);
        assert_eq!(found.len(), 2 * 3 * 2 * 2 * 2 * 2);
        found.sort();
        found.dedup();
        assert_eq!(found.len(), 96, "keys differ");
        assert_eq!(keys(&format!("{one} --scales 1,1")).len(), 1, "twice the same is once");
        let named = keys("--techniques flat.two-pass.point --views centre,distance,centre");
        assert!(named.len() == 2 && named[0].contains(" view centre 640x640"), "{named:?}");
        // The same whatever else is asked for: what is finished is not done again.
        assert!(keys("--techniques flat.two-pass.point --views border,centre").contains(&named[0]));
        assert_eq!(
            keys("--views 1 --techniques flat.opaque.point --tolerances 1,2").len(),
            1,
            "opaque has no tolerance"
        );
        let one_pass =
            "--views 1 --factors 0.4,1 --voronois cones,off --fronts nearest,first --storages as-read,morton";
        let of = |technique: &str| keys(&format!("{one_pass} --techniques {technique}")).len();
        assert_eq!([of("flat.two-pass.point"), of("flat.fuzzy.point"), of("flat.groups.point")], [2, 4, 8]);
        assert_eq!(indices([2, 1, 2]), [[0, 0, 0], [0, 0, 1], [1, 0, 0], [1, 0, 1]]);
    }

    #[test]
    fn inputs_of_one_name_are_refused() {
        let scene = |seed| Input::Scene { name: "torus".into(), points: 9, seed };
        let file = |path: &str| Input::File(path.into());
        assert!(distinct(&[file("a/x.ply"), file("a/y.ply"), scene(1), scene(2)]).is_ok());
        assert!(distinct(&[file("a/x.ply"), scene(1), file("b/x.ply")]).unwrap_err().0.contains("x.ply"));
        assert!(distinct(&[scene(1), scene(1)]).is_err());
    }

    #[test]
    fn a_combination_is_drawn_as_it_is_named() {
        let args = sweep("--ellipses approximate --sums half --scales 0.5 --tolerances 3");
        let combination = &plan(&args, "a", "s")[0];
        let way = way(combination, &Style::default()).unwrap();
        assert_eq!((way.style.ellipse, way.style.sums), (Ellipse::Approximate, SumPrecision::Half));
        assert_eq!((way.style.radius_scale, way.style.tolerance.relative), (0.5, 3.0));
        assert_eq!(way.technique, PRESETS[0].1);
        let args = sweep("--techniques flat.groups.quad --factors 0.5 --voronois slabs --storages random");
        let way = self::way(&plan(&args, "a", "s")[0], &Style::default()).unwrap();
        assert_eq!(
            (way.form, way.style.voronoi),
            (Form { factor: Some(0.5), storage: Arrangement::Random, structure: Structure::Flat }, Voronoi::Slabs)
        );
    }
}
