//! `supervol chart`: report of speed against accuracy, or of the regimes in which methods fail, measured on this
//! machine.

use std::io::Write;
use std::path::Path;

use supervol_arguments::chart::Arguments;
use supervol_arguments::failure::{Failure, with_output};
use supervol_arguments::output::ReportFolder;
use supervol_arguments::progress::announce;
use supervol_arguments::terminal::stdout;
use supervol_files::unfinished::UnfinishedFolder;
use supervol_measure::record::RegimeRecord;
use supervol_measure::report::{Circumstances, Extent, Report, chart_page, stability_page};
use supervol_measure::scenes::SceneSpec;
use supervol_measure::stability::regime::Regime;
use supervol_measure::{
    Context, Scale, chart, convergence, leaping, points, reading, record, scenes, stability, storage,
};

/// Name of the file that the stability suite leaves for the next report.
const STABILITY: &str = "stability.json";

/// Runs the command.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let scenes = chosen_scenes(&arguments.scene)?;
    let regimes = chosen_regimes(&arguments.only)?;
    let extent = if arguments.summary { Extent::Summary } else { Extent::Whole };
    let folder = &arguments.output;
    let cannot_write = |e| Failure::Machine(format!("cannot write {}: {e}", folder.display()));
    let reports = ReportFolder::begin(folder, arguments.force)?;
    let containers = UnfinishedFolder::create_in(folder).map_err(cannot_write)?;
    let context = Context {
        scale: if arguments.quick { Scale::Small } else { Scale::Full },
        folder: containers.path(),
        say: &announce,
    };
    let here = Circumstances::now(&arguments.command_line());
    if arguments.stability {
        run_stability(&context, &regimes, &here, &reports)
    } else {
        run_chart(&context, &scenes, &here, &reports, extent)
    }
}

fn run_chart(
    context: &Context<'_>,
    scenes: &[&SceneSpec],
    here: &Circumstances,
    reports: &ReportFolder<'_>,
    extent: Extent,
) -> Result<(), Failure> {
    let folder = reports.folder;
    // First of all: it says how much memory builds take beside what is there.
    let storage = &storage::for_report(context)?;
    let chart = chart::run(context, scenes)?;
    let stability = recorded_stability(folder)?;
    let convergence = convergence::table(context)?;
    let leaping = leaping::for_report(context)?;
    let reading = &reading::for_report(context)?;
    let (convergence, leaping, stability) = (&convergence, &leaping, stability.as_deref());
    let page = chart_page(&Report { chart: &chart, convergence, leaping, reading, storage, stability, here, extent });
    let mut files = vec![("report.html".into(), page.into_bytes())];
    if extent == Extent::Whole {
        files.push(("points.json".into(), points::to_json(&chart.points).into_bytes()));
        files.push(("points.csv".into(), points::to_csv(&chart.points).into_bytes()));
    }
    reports.write(&files, &[])?;
    let defaults = chart.points.iter().filter(|p| p.default);
    let worst = defaults.clone().map(|p| p.linf).fold(0.0, f64::max);
    let on_front = defaults.clone().filter(|p| p.pareto).count();
    let mut out = stdout();
    writeln!(
        out,
        "{}: {} points; the default is on the Pareto front of {on_front} of {} pictures; its largest error is {:.3} grey \
         levels of 255",
        folder.join("report.html").display(),
        chart.points.len(),
        defaults.count(),
        worst * 255.0
    )
    .map_err(with_output)?;
    chart.notes.iter().chain(&storage.notes).try_for_each(|note| writeln!(out, "note: {note}")).map_err(with_output)
}

/// Records of an earlier `--stability` run in this folder.
fn recorded_stability(folder: &Path) -> Result<Option<Vec<RegimeRecord>>, Failure> {
    let path = folder.join(STABILITY);
    match std::fs::read_to_string(&path) {
        Ok(text) => {
            let records = serde_json::from_str(&text);
            records
                .map(Some)
                .map_err(|e| Failure::Data(format!("{}: expected a record of regimes: {e}", path.display())))
        }
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => Ok(None),
        Err(e) => Err(Failure::Machine(format!("cannot read {}: {e}", path.display()))),
    }
}

fn run_stability(
    context: &Context<'_>,
    regimes: &[&'static Regime],
    here: &Circumstances,
    reports: &ReportFolder<'_>,
) -> Result<(), Failure> {
    let records = record::run(context, regimes);
    let page = stability_page(&records, here);
    let files = [(STABILITY, record::to_json(&records)), ("stability.html", page)];
    reports.write(&files.map(|(name, text)| (name.into(), text.into_bytes())), &[])?;
    print_records(&records).map_err(with_output)
}

fn print_records(records: &[RegimeRecord]) -> std::io::Result<()> {
    let mut out = stdout();
    let text = |value: Option<f64>| value.map_or_else(|| "-".into(), |v| format!("{v:.3e}"));
    for record in records {
        let verdict = if record.pass { "PASS" } else { "FAIL" };
        let (id, title) = (&record.id, &record.title);
        writeln!(out, "{verdict} {id}  {:>10} of {:>10}  {title}", text(record.value), text(record.gate))?;
        for gate in record.gates.iter().filter(|gate| !gate.pass) {
            let side = if gate.side == "at_most" { "at most" } else { "at least" };
            writeln!(out, "          {}: {}, expected {side} {}", gate.what, text(gate.value), text(gate.limit))?;
        }
    }
    let passed = records.iter().filter(|record| record.pass).count();
    writeln!(out, "{passed} of {} regimes pass, {} fail", records.len(), records.len() - passed)
}

/// The scenes of these names; all without names.
fn chosen_scenes(names: &[String]) -> Result<Vec<&'static SceneSpec>, Failure> {
    if names.is_empty() {
        return Ok(scenes::SCENES.iter().collect());
    }
    let known = || scenes::SCENES.iter().map(|s| s.name).collect::<Vec<_>>().join(", ");
    let find = |name: &String| {
        let found = scenes::scene(name);
        found.ok_or_else(|| Failure::Command(format!("--scene {name}: expected one of {}", known())))
    };
    names.iter().map(find).collect()
}

/// The regimes of these ids; all without ids.
fn chosen_regimes(ids: &[String]) -> Result<Vec<&'static Regime>, Failure> {
    let all = stability::regimes();
    if let Some(unknown) = ids.iter().find(|id| !all.iter().any(|regime| regime.id == id.as_str())) {
        let known = all.iter().map(|regime| regime.id).collect::<Vec<_>>().join(", ");
        let waiting = stability::WAITING.iter().find(|(id, _)| id == unknown);
        let why = waiting.map_or_else(String::new, |(_, what)| format!(" (not implemented yet: {what})"));
        return Err(Failure::Command(format!("--only {unknown}: unknown regime{why}; expected one of {known}")));
    }
    Ok(all.into_iter().filter(|regime| ids.is_empty() || ids.iter().any(|id| id == regime.id)).collect())
}
