//! Every argument that can be a path is known to the guard, as an input or as an output.

use super::of_command;
use crate::args::{Cli, Command};
use clap::{ArgAction, CommandFactory, Parser, ValueHint};
use std::collections::BTreeSet;

/// Words of value names that stand for files, beside the arguments whose values are paths.
const FILE_WORDS: [&str; 10] =
    ["FILM", "CHART", "PACK", "DESIGN", "LENS", "RAW", "FILE", "PATH", "GROUP", "FLAT"];

/// Command lines in which each path is the name of its argument: of positions the first letters of a name are those of `--help`.
/// After `|` the arguments that are outputs.
const LINES: &[&str] = &[
    "demo --dir=dir | dir",
    "chart uniform out | out",
    "chart image file out | out",
    "chart motion chart out --motion=motion.csv --exposure=1s | out",
    "scene mesh out --lens=lens --film-size=9 --film-pitch-um=2 --material=m=material.csv --illuminant=illuminant.csv --environment=environment.exr --glass-catalog=glass_catalog --coatings=coatings.toml | out",
    "lens show lens --plot=plot --csv=csv --glass-catalog=glass_catalog --coatings=coatings.toml | plot csv",
    "lens psf design out.npy --sections=sections --glass-catalog=glass_catalog --coatings=coatings.toml | out.npy sections",
    "lens diff a b --glass-catalog=glass_catalog |",
    "lens trace design out --glass-catalog=glass_catalog --coatings=coatings.toml --tolerances=tolerances.toml --sensor-reflectance=sensor_reflectance.csv | out",
    "lens tolerance design tolerances.toml --out=out --glass-catalog=glass_catalog --coatings=coatings.toml | out",
    "lens tolerance design --import-tol --output=output --glass-catalog=glass_catalog | output",
    "lens camera design --film-size=9 --glass-catalog=glass_catalog |",
    "lens export lens out --as=lut --glass-catalog=glass_catalog --coatings=coatings.toml | out",
    "lens export lens out --as=psf-npy --grid=2 | out",
    "lens export lens out --as=psf-fits --wavelengths=450,550 | out",
    "lens list --plot=plot | plot",
    "lens convert design out.zmx --glass-catalog=glass_catalog --coatings=coatings.toml | out.zmx",
    "lens import source out | out",
    "lens import --template=template | template",
    "depth scene --lens=lens --glass-catalog=glass_catalog --depth=depth --hidden=hidden --plot=plot.png --coatings=coatings.toml | plot.png",
    "run chart film --lens=lens --tolerances=tolerances.toml --glass-catalog=glass_catalog --depth=depth --hidden=hidden --coatings=coatings.toml --sensor-reflectance=sensor_reflectance.csv --material=m=material.csv --illuminant=illuminant.csv --environment=environment.exr | film",
    "sensor film raw --sensor=sensor --exposure=1s --lens=lens | raw",
    "sensor film raw --sensor=sensor --exposure=1s --chief-ray-angles=chief_ray_angles.csv | raw",
    "sensor film raw --sensor=sensor --exposure=1s --motion=motion.csv | raw",
    "sensor show sensor --plot=plot | plot",
    "sensor validate sensor --out=out | out",
    "develop raw out.png --matrix=matrix --shading=shading | out.png",
    "shoot chart out.png --lens=lens --glass-catalog=glass_catalog --sensor=sensor --depth=depth --hidden=hidden --keep=keep --coatings=coatings.toml --sensor-reflectance=sensor_reflectance.csv | out.png keep",
    "compare first second --out=out | out",
    "restore film out --lens=lens --film=of_film | out",
    "dataset recipe out | out",
    "plan chart film --lens=lens --tolerances=tolerances.toml --glass-catalog=glass_catalog --depth=depth --hidden=hidden --output=output --lens-pack=lens_pack --coatings=coatings.toml --sensor-reflectance=sensor_reflectance.csv | film output lens_pack",
    "export film out.npy | out.npy",
    "validate --lens=lens --against=against --timing=timing --coatings=coatings.toml --out=out | out",
    "measure film --points=1,1 --csv=csv --json=json | csv json",
    "measure film --profile=1,1,5,5 --plot=plot.png | plot.png",
    "measure film --flare=9,9,3 --map=map.png | map.png",
    "report picture --chart=checker --against=against --out=out | out",
    "man dir | dir",
    "pyramid film |",
    "verify film |",
    "status film |",
    "view film --chart=chart --lens=lens |",
    "lens light lens |",
    "bench --lens=lens |",
];

/// Arguments that can be paths and are not in [`LINES`]: commands that write nothing beside their input or a temporary directory, and the
/// plan of `run`, which is read before its job is known.
const NOT_GUARDED: &[&str] = &[
    "run plan",
    "run allow_path",
    "scene allow_path",
    "status plan",
    "bench dir",
    "bench compare",
    "lens diff glass_catalog",
    "lens diff coatings",
    "lens light glass_catalog",
    "lens light coatings",
    "lens light sensor_reflectance",
    "lens camera glass_catalog",
    "lens camera coatings",
];

/// Ids of the arguments of `command` and its subcommands whose values can be paths, as `lens show plot`.
fn path_arguments(command: &clap::Command, name: &str, found: &mut BTreeSet<String>) {
    for argument in command.get_arguments() {
        let takes_value = matches!(argument.get_action(), ArgAction::Set | ArgAction::Append);
        let words = argument.get_value_names().unwrap_or_default().join("|");
        let is_named = words.split(['|', '.', '_', ' ']).any(|word| FILE_WORDS.contains(&word));
        let is_choice = !argument.get_possible_values().is_empty();
        if takes_value && !is_choice && (is_named || argument.get_value_hint() == ValueHint::AnyPath) {
            found.insert(format!("{name}{}", argument.get_id()));
        }
    }
    for inner in command.get_subcommands() {
        path_arguments(inner, &format!("{name}{} ", inner.get_name()), found);
    }
}

/// Command, and the values of `--flag=value`, `--flag=name=value` and of positions in `line`.
fn words(line: &str) -> (String, Vec<String>) {
    let all: Vec<&str> = line.split_whitespace().collect();
    let has_subcommand = match all[0] {
        "lens" => true,
        "sensor" => ["show", "validate"].contains(&all[1]),
        "chart" => ["image", "motion"].contains(&all[1]),
        _ => false,
    };
    let n = if has_subcommand { 2 } else { 1 };
    let values =
        all[n..].iter().map(|word| word.rsplit_once('=').map_or(*word, |(_, value)| value).to_owned());
    (all[..n].join(" "), values.collect())
}

#[test]
fn every_path_of_every_command_is_guarded() {
    let mut all = BTreeSet::new();
    path_arguments(&Cli::command(), "", &mut all);
    let mut known: BTreeSet<String> = NOT_GUARDED.iter().map(|name| (*name).to_owned()).collect();
    for line in LINES {
        let (line, outputs) = line.split_once('|').unwrap();
        let outputs: Vec<&str> = outputs.split_whitespace().collect();
        let (command, values) = words(line);
        let parsed = Cli::try_parse_from(["lenscube"].into_iter().chain(line.split_whitespace())).unwrap();
        let [read, written] = guarded(&parsed.command);
        for value in values {
            let id = format!("{command} {}", value.split('.').next().unwrap());
            if !all.contains(&id) || NOT_GUARDED.contains(&&*id) {
                continue;
            }
            let begins =
                |paths: &BTreeSet<String>| paths.iter().any(|path| path.split('/').next() == Some(&value));
            assert_eq!(
                (begins(&read), begins(&written)),
                (!outputs.contains(&&*value), outputs.contains(&&*value)),
                "{id}: read {read:?}, written {written:?}"
            );
            known.insert(id);
        }
    }
    let forgotten: Vec<&String> = all.difference(&known).collect();
    assert!(forgotten.is_empty(), "arguments without a line in LINES: {forgotten:?}");
    let gone: Vec<&String> = known.difference(&all).collect();
    assert!(gone.is_empty(), "no arguments of any command: {gone:?}");
}

fn guarded(command: &Command) -> [BTreeSet<String>; 2] {
    let guard = of_command(command).unwrap();
    guard.paths().map(|paths| paths.iter().map(|path| path.display().to_string()).collect())
}
