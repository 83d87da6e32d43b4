//! The tables of ARCHITECTURE.md against what the crates really depend on.

use cargo_metadata::{DependencyKind, MetadataCommand};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// Who may use what, as ARCHITECTURE.md says it.
struct Rules {
    /// In the order of the table.
    crates: Vec<CrateRule>,
    /// Who may know a library; everyone if there is no list.
    libraries: BTreeMap<String, Option<BTreeSet<String>>>,
}

struct CrateRule {
    name: String,
    may_use: BTreeSet<String>,
    tests_may_use: BTreeSet<String>,
}

/// The crate that is nothing but tests.
const TESTS: &str = "end-to-end";

/// One line of a `[dependencies]` table.
#[derive(Clone, Debug)]
struct Edge {
    from: String,
    to: String,
    ours: bool,
    only_in_tests: bool,
}

impl Rules {
    fn parse(text: &str) -> Self {
        let crates = rows(section(text, "Crates"))
            .map(|cells| CrateRule {
                name: names(cells[0]).into_iter().next().expect("a row begins with a crate's name"),
                may_use: names(cells[2]),
                tests_may_use: names(cells[3]),
            })
            .collect();
        let libraries = rows(section(text, "Libraries"))
            .flat_map(|cells| {
                let users = (cells[1].trim() != "everyone").then(|| names(cells[1]));
                names(cells[0]).into_iter().map(move |library| (library, users.clone()))
            })
            .collect();
        Self { crates, libraries }
    }

    /// What is wrong with the table itself: arrows that do not point up, users that are no crates.
    fn contradictions(&self) -> Vec<String> {
        let mut found = Vec::new();
        let mut above = BTreeSet::new();
        for rule in &self.crates {
            for used in rule.may_use.union(&rule.tests_may_use).filter(|used| !above.contains(*used)) {
                found.push(format!("'{used}' stands not above '{}', which may use it", rule.name));
            }
            if !above.insert(rule.name.clone()) {
                found.push(format!("'{}' has two rows", rule.name));
            }
        }
        for (library, users) in &self.libraries {
            for user in users.iter().flatten().filter(|user| !above.contains(*user)) {
                found.push(format!("'{user}', which may know {library}, is no crate"));
            }
        }
        found
    }

    /// What is wrong with a workspace of these crates and edges.
    fn violations(&self, crates: &BTreeSet<String>, edges: &[Edge]) -> Vec<String> {
        let mut found = Vec::new();
        let rules: BTreeMap<&str, &CrateRule> =
            self.crates.iter().map(|rule| (rule.name.as_str(), rule)).collect();
        for name in crates.iter().filter(|name| !rules.contains_key(name.as_str())) {
            found.push(format!("crate '{name}' has no row"));
        }
        for name in rules.keys().filter(|name| !crates.contains(**name)) {
            found.push(format!("crate '{name}' has a row and does not exist"));
        }
        for Edge { from, to, ours, only_in_tests } in edges {
            let Some(rule) = rules.get(from.as_str()) else { continue };
            let allowed = match (ours, only_in_tests) {
                (true, false) => rule.may_use.contains(to),
                (true, true) => rule.may_use.contains(to) || rule.tests_may_use.contains(to),
                (false, false) => match self.libraries.get(to) {
                    Some(Some(users)) => users.contains(from),
                    Some(None) => true,
                    None => false,
                },
                (false, true) => true,
            };
            if !allowed {
                let whose = if *only_in_tests { "the tests of " } else { "" };
                found.push(format!("{whose}'{from}' must not know '{to}'"));
            }
        }
        found
    }
}

/// The text between a heading of the second level and the next.
fn section<'a>(text: &'a str, heading: &str) -> &'a str {
    let (_, rest) = text.split_once(&format!("\n## {heading}\n")).expect("the heading is there");
    rest.split("\n## ").next().expect("split gives at least one part")
}

/// The cells of a table's rows, without its header.
fn rows(section: &str) -> impl Iterator<Item = Vec<&str>> {
    section
        .lines()
        .filter(|line| line.starts_with('|'))
        .skip(2)
        .map(|line| line.trim_matches('|').split('|').map(str::trim).collect())
}

/// What stands in backquotes.
fn names(cell: &str) -> BTreeSet<String> {
    cell.split('`').skip(1).step_by(2).map(str::to_owned).collect()
}

fn rules() -> Rules {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../ARCHITECTURE.md");
    let text = std::fs::read_to_string(&path).expect("ARCHITECTURE.md is there");
    Rules::parse(&text)
}

fn workspace() -> (BTreeSet<String>, Vec<Edge>) {
    let metadata = MetadataCommand::new()
        .manifest_path(Path::new(env!("CARGO_MANIFEST_DIR")).join("../Cargo.toml"))
        .no_deps()
        .exec()
        .expect("cargo metadata works");
    let crates = metadata.packages.iter().map(|package| package.name.to_string()).collect();
    let edges = metadata
        .packages
        .iter()
        .flat_map(|package| {
            package.dependencies.iter().map(|dependency| Edge {
                from: package.name.to_string(),
                to: dependency.name.clone(),
                ours: dependency.path.is_some(),
                only_in_tests: dependency.kind == DependencyKind::Development || *package.name == TESTS,
            })
        })
        .collect();
    (crates, edges)
}

#[track_caller]
fn assert_none(found: &[String]) {
    assert!(found.is_empty(), "against ARCHITECTURE.md:\n  {}\n", found.join("\n  "));
}

#[test]
fn crates_know_only_what_the_map_allows() {
    let (crates, edges) = workspace();
    assert!(edges.len() > crates.len(), "cargo metadata gave {} edges", edges.len());
    assert_none(&rules().violations(&crates, &edges));
}

#[test]
fn all_arrows_of_the_map_point_one_way() {
    assert_none(&rules().contradictions());
}

/// The map forbids this edge, and the check above would find it.
#[track_caller]
fn check_is_found(from: &str, to: &str, ours: bool, expected: &str) {
    let (crates, mut edges) = workspace();
    edges.push(Edge { from: from.into(), to: to.into(), ours, only_in_tests: false });
    let found = rules().violations(&crates, &edges);
    assert!(found.iter().any(|violation| violation == expected), "expected '{expected}' in {found:?}");
}

#[test]
fn forbidden_edges_are_found() {
    check_is_found("wire", "quinn", false, "'wire' must not know 'quinn'");
    check_is_found("wire", "spatial", true, "'wire' must not know 'spatial'");
    check_is_found("session", "tokio", false, "'session' must not know 'tokio'");
    check_is_found("session", "netsim", true, "'session' must not know 'netsim'");
    check_is_found("render", "codec", true, "'render' must not know 'codec'");
    check_is_found("server", "openh264", false, "'server' must not know 'openh264'");
    check_is_found("headset", "render", true, "'headset' must not know 'render'");
    check_is_found("transport", "wire", true, "'transport' must not know 'wire'");
}

#[test]
fn a_library_that_nobody_was_allowed_is_found() {
    check_is_found("scene", "left-pad", false, "'scene' must not know 'left-pad'");
}

#[test]
fn a_crate_without_a_row_is_found_and_a_row_without_a_crate() {
    let (mut crates, edges) = workspace();
    crates.insert("util".into());
    crates.remove("netsim");
    let found = rules().violations(&crates, &edges);
    assert!(found.contains(&"crate 'util' has no row".to_owned()), "{found:?}");
    assert!(found.contains(&"crate 'netsim' has a row and does not exist".to_owned()), "{found:?}");
}

#[test]
fn an_arrow_that_points_down_is_found() {
    let mut rules = rules();
    let volume = rules.crates.iter_mut().find(|rule| rule.name == "volume").expect("there is a row");
    volume.may_use.insert("server".into());
    assert_eq!(rules.contradictions(), ["'server' stands not above 'volume', which may use it"]);
}
