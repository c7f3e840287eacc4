//! `supervol build --batch`: builds many volumes one after the other; each outcome is one line of a file.

use std::io::Write;
use std::path::Path;

use supervol_arguments::failure::{Failure, with_output};
use supervol_arguments::flags;
use supervol_arguments::input::read_text_up_to;
use supervol_arguments::progress::announce;
use supervol_arguments::quantity::show_bytes;
use supervol_arguments::source::{SourceArguments, open};
use supervol_arguments::terminal::Format;
use supervol_files::OutputError;
use supervol_format::readable::counted;
use supervol_preprocess::batch::inputs::{Headerless, INPUTS_LIMIT, Inputs, of_folder, of_list};
use supervol_preprocess::batch::results::{FILE_NAME, Record, Results, Status};
use supervol_preprocess::batch::{
    Standing, check_outside, checksum_of, checksum_of_container, describe_options, others_of, standing,
};
use supervol_preprocess::kept::Reading;
use supervol_preprocess::naming::container_names;
use supervol_preprocess::{BuildError, Existing};

use crate::build::OutputArguments;

/// Size limit of a list of inputs.
const LIST_LIMIT_BYTES: u64 = 256 << 20;

/// Common data of all inputs of a batch.
struct Batch<'a> {
    output: &'a OutputArguments,
    folder: &'a Path,
    reading: Reading,
    /// Options that affect voxels, as text.
    options: String,
}

/// Outcome of an input without failure.
enum Outcome {
    /// The container exists, and nothing has changed.
    Unchanged,
    Built,
}

/// Runs the command.
pub fn run(batch: &Path, output: &OutputArguments, source: &SourceArguments) -> Result<(), Failure> {
    let folder = output.named("a folder")?;
    let headerless = if source.is_raw() { Headerless::Taken } else { Headerless::PassedOver };
    let Inputs { paths, passed_over } = find(batch, folder, headerless)?;
    if paths.is_empty() {
        let left = counted(passed_over, "file");
        let message = format!("{}: expected volumes, found none (skipped {left})", batch.display());
        return Err(Failure::Command(message));
    }
    let made = std::fs::create_dir_all(folder);
    made.map_err(|source| BuildError::write(folder, source))?;
    let mut results = Results::open(folder)?;
    let reading = source.reading(output.memory_bytes())?;
    let options = describe_options(&output.build_options(), &reading);
    let batch = Batch { output, folder, reading, options };
    let names = container_names(&paths, results.records());

    let (mut built, mut unchanged, mut failed, mut code) = (0u64, 0u64, 0u64, 0);
    for (i, (input, name)) in paths.iter().zip(&names).enumerate() {
        let place = format!("[{}/{}] {}", i + 1, paths.len(), input.display());
        match batch.one(input, name, &mut results) {
            Ok(Outcome::Unchanged) => {
                unchanged += 1;
                announce(&format!("{place}: unchanged, done before"));
            }
            Ok(Outcome::Built) => {
                built += 1;
                let record = &results.records()[&*input.to_string_lossy()];
                let bytes = show_bytes(record.container_bytes.unwrap_or(0));
                let percent = 100.0 * record.ratio.unwrap_or(0.0);
                let seconds = record.milliseconds.unwrap_or(0.0) / 1e3;
                announce(&format!("{place}: {name}, {bytes} ({percent:.1} %), {seconds:.1} s"));
            }
            Err(error) => {
                // A full disk stops the batch. Another build would fail, too, and would remove the journal of this
                // one.
                let is_full = error.is_full_disk();
                let failure = Failure::from(error);
                failed += 1;
                code = code.max(failure.code());
                batch.note_failure(input, name, &mut results, &failure);
                announce(&place);
                failure.print();
                if is_full {
                    return Err(Failure::Reported(code));
                }
            }
        }
        batch.write_line(results.records().get(&*input.to_string_lossy()))?;
    }
    announce(&format!(
        "{}: {built} built, {unchanged} done before, {failed} failed, {} passed over; {}",
        folder.display(),
        counted(passed_over, "other file"),
        folder.join(FILE_NAME).display()
    ));
    if code == 0 { Ok(()) } else { Err(Failure::Reported(code)) }
}

fn find(batch: &Path, output: &Path, headerless: Headerless) -> Result<Inputs, Failure> {
    if batch.is_dir() {
        return Ok(of_folder(batch, output, headerless)?);
    }
    let inputs = of_list(&read_text_up_to(LIST_LIMIT_BYTES, batch, "a list of volumes")?);
    if inputs.paths.len() > INPUTS_LIMIT {
        let found = inputs.paths.len();
        return Err(Failure::Command(format!(
            "{}: expected at most {INPUTS_LIMIT} volumes, found {found}",
            batch.display()
        )));
    }
    Ok(inputs)
}

impl Batch<'_> {
    /// Builds one volume, or finds that it is built already.
    fn one(&self, input: &Path, name: &str, results: &mut Results) -> Result<Outcome, BuildError> {
        let output = self.folder.join(name);
        let Some(source_name) = input.to_str() else {
            return Err(BuildError::Options(format!(
                "{}: expected a path in UTF-8, which {FILE_NAME} needs",
                input.display()
            )));
        };
        check_outside(input, self.folder)?;
        let known = results.records().get(source_name).cloned();
        let existing = match standing(input, &output, known.as_ref(), &self.options) {
            Ok(Standing::Done) => {
                if let Some(known) = known.filter(|record| record.status != Status::Done) {
                    results.add(Record { status: Status::Done, error: None, ..known })?;
                }
                return Ok(Outcome::Unchanged);
            }
            Ok(Standing::New) => self.output.existing(),
            Ok(Standing::Interrupted) => Existing::Replace,
            Err(BuildError::Output(OutputError::Exists { .. }) | BuildError::Outdated { .. })
                if self.output.existing() == Existing::Replace =>
            {
                Existing::Replace
            }
            Err(error) => return Err(error),
        };
        let (source, origin) = open(&self.reading, input, self.folder)?;
        let others = others_of(input, source.as_ref());
        let is_one_file = others.is_empty() && !input.is_dir();
        let checksum = if is_one_file { origin.xxh3_64.clone() } else { checksum_of(input, &others)? };
        let begun = Record {
            source: source_name.into(),
            status: Status::Begun,
            container: name.into(),
            source_xxh3_64: checksum,
            source_bytes: origin.bytes,
            source_files: others.iter().map(|path| path.to_string_lossy().into_owned()).collect(),
            manifest_xxh3_64: origin.xxh3_64.clone(),
            options: self.options.clone(),
            ..Record::default()
        };
        results.add(begun.clone())?;
        let report = self.output.build_at(&output, existing, source.as_ref(), origin)?;
        let (container_xxh3_64, container_bytes) = checksum_of_container(&output)?;
        results.add(Record {
            status: Status::Done,
            container_xxh3_64: Some(container_xxh3_64),
            container_bytes: Some(container_bytes),
            voxel_bytes: Some(report.source_bytes),
            ratio: Some(container_bytes as f64 / report.source_bytes as f64),
            error_bound: report.levels.first().map(|level| level.error),
            milliseconds: Some(report.wall_ms),
            notes: report.notes.iter().map(flags::note).collect(),
            ..begun
        })?;
        Ok(Outcome::Built)
    }

    /// Records the failure of an input. The record of an existing container stays.
    fn note_failure(&self, input: &Path, name: &str, results: &mut Results, failure: &Failure) {
        let source = input.to_string_lossy().into_owned();
        let known = results.records().get(&source).cloned();
        let known = known.unwrap_or_else(|| Record { source, container: name.into(), ..Record::default() });
        let error = failure.message().map(str::to_owned);
        if let Err(error) = results.add(Record { status: Status::Failed, error, ..known }) {
            Failure::from(error).print();
        }
    }

    /// Prints one line of JSON, if requested.
    fn write_line(&self, record: Option<&Record>) -> Result<(), Failure> {
        if self.output.format() == Format::Text {
            return Ok(());
        }
        writeln!(supervol_arguments::terminal::stdout(), "{}", serde_json::json!({ "result": record }))
            .map_err(with_output)
    }
}
