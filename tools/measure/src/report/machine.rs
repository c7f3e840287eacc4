//! Machine, date and command of a measurement.

use std::time::{SystemTime, UNIX_EPOCH};

/// Circumstances shown in every report.
#[derive(Debug, Clone, PartialEq)]
pub struct Circumstances {
    /// Model name of the processor.
    pub processor: String,
    /// Number of processors available to threads.
    pub processors: usize,
    /// Memory of the machine, GiB; `None` if the system does not report it.
    pub memory_gib: Option<f64>,
    /// Operating system.
    pub system: String,
    /// Version of Supervol and how it was compiled.
    pub version: String,
    /// Date, `2026-01-31`, UTC.
    pub date: String,
    /// The command line.
    pub command: String,
}

impl Circumstances {
    /// Circumstances of this process.
    #[must_use]
    pub fn now(command: &str) -> Self {
        let read = |path: &str| std::fs::read_to_string(path).unwrap_or_default();
        let cpu = field(&read("/proc/cpuinfo"), "model name", ':');
        let memory = field(&read("/proc/meminfo"), "MemTotal", ':');
        let kibibytes = memory.and_then(|m| m.strip_suffix(" kB").and_then(|n| n.trim().parse::<f64>().ok()));
        let system = field(&read("/etc/os-release"), "PRETTY_NAME", '=').map(|name| name.trim_matches('"').to_string());
        let profile = if cfg!(debug_assertions) { "development build: slower than a release" } else { "release build" };
        let seconds = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |d| d.as_secs());
        Self {
            processor: cpu.unwrap_or_else(|| "unknown processor".into()),
            processors: std::thread::available_parallelism().map_or(1, usize::from),
            memory_gib: kibibytes.map(|k| k / f64::from(1 << 20)),
            system: system.unwrap_or_else(|| std::env::consts::OS.into()) + ", " + std::env::consts::ARCH,
            version: format!("Supervol {}, {profile}", env!("CARGO_PKG_VERSION")),
            date: date_of(seconds),
            command: command.into(),
        }
    }
}

/// Name of this kind of machine, for folders of records: `epyc-zen4-2-cores`. Machines with one name are comparable but
/// not equal: clocks and caches differ within a family.
#[must_use]
pub fn short_name() -> String {
    let known = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    format!("{}-{cores}-cores", processor_name(&known))
}

/// Product and generation of AMD processors since 2017; the model name of other processors, in lower case with dashes.
fn processor_name(cpuinfo: &str) -> String {
    let name = field(cpuinfo, "model name", ':').unwrap_or_else(|| std::env::consts::ARCH.into());
    let number = |key: &str| field(cpuinfo, key, ':').and_then(|n| n.parse::<u32>().ok());
    let generation = number("cpu family").zip(number("model")).and_then(|(family, model)| zen(family, model));
    let product = name.strip_prefix("AMD ").and_then(|rest| rest.split_whitespace().next());
    let text = match (product, generation) {
        (Some(product), Some(generation)) => format!("{product} {generation}"),
        _ => name.replace("(R)", "").replace("(TM)", ""),
    };
    let dashed: String = text.to_lowercase().chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '-' }).collect();
    dashed.split('-').filter(|part| !part.is_empty()).collect::<Vec<_>>().join("-")
}

/// Generation of an AMD processor by its family and model ("Processor Programming Reference" of each; Linux `amd.c`).
fn zen(family: u32, model: u32) -> Option<&'static str> {
    match (family, model) {
        (0x17, 0x00..=0x2f) => Some("zen1"),
        (0x17, _) => Some("zen2"),
        (0x19, 0x00..=0x0f | 0x20..=0x5f) => Some("zen3"),
        (0x19, 0x10..=0x1f | 0x60..=0xaf) => Some("zen4"),
        (0x1a, 0x00..=0x4f | 0x60..=0x7f) => Some("zen5"),
        _ => None,
    }
}

/// Value of the first line of the form `name <separator> value`.
fn field(text: &str, name: &str, separator: char) -> Option<String> {
    let value = |line: &str| {
        let (key, value) = line.split_once(separator)?;
        (key.trim() == name).then(|| value.trim().to_string())
    };
    text.lines().find_map(value)
}

/// Gregorian date of a number of seconds since 1970 (Hinnant 2021, "chrono-compatible low-level date algorithms").
fn date_of(seconds: u64) -> String {
    let days = seconds / 86_400 + 719_468;
    let (era, day_of_era) = (days / 146_097, days % 146_097);
    let year_of_era = (day_of_era - day_of_era / 1460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let shifted_month = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * shifted_month + 2) / 5 + 1;
    let month = if shifted_month < 10 { shifted_month + 3 } else { shifted_month - 9 };
    let year = year_of_era + era * 400 + u64::from(month <= 2);
    format!("{year:04}-{month:02}-{day:02}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dates_are_civil() {
        assert_eq!(date_of(0), "1970-01-01");
        assert_eq!(date_of(951_782_400), "2000-02-29");
        assert_eq!(date_of(1_798_761_599), "2026-12-31");
    }

    #[test]
    fn machines_are_named_by_product_and_generation() {
        let of = |family, model, name| {
            processor_name(&format!("cpu family\t: {family}\nmodel\t\t: {model}\nmodel name\t: {name}\n"))
        };
        assert_eq!(of(25, 17, "AMD EPYC"), "epyc-zen4");
        assert_eq!(of(26, 2, "AMD EPYC"), "epyc-zen5");
        assert_eq!(of(25, 33, "AMD Ryzen 9 5950X 16-Core Processor"), "ryzen-zen3");
        assert_eq!(of(6, 143, "Intel(R) Xeon(R) Platinum 8481C"), "intel-xeon-platinum-8481c");
        assert_eq!(processor_name(""), std::env::consts::ARCH.replace('_', "-"));
        assert!(short_name().ends_with("-cores"));
    }

    #[test]
    fn fields_are_found_by_name() {
        assert_eq!(field("a: 1\nmodel name\t: X Y\n", "model name", ':').as_deref(), Some("X Y"));
        assert_eq!(field("a: 1", "b", ':'), None);
        let here = Circumstances::now("supervol chart");
        assert!(here.processors > 0 && here.command == "supervol chart");
    }
}
