//! The methods of the chart, as data: all choices that the renderer offers, and the methods of comparison.
//!
//! [`methods`] is the whole list. Each entry states the looks on which it is measured ([`On`]):
//! - methods that change the integration of a ray: on all looks;
//! - gradient operators: only on shaded looks;
//! - accumulation precision, codecs, storage, reconstruction and the GPU backend: on one look of each scene (shaded
//!   where shading matters). Their effect hardly depends on the transfer function.
//!
//! The default is a curve over the requested error (`--max-error`, [`ERRORS`]), measured on all looks. The default
//! settings are one point of this curve.

use supervol_format::Lod;
use supervol_format::codec::{Codec, CodecChoice};
use supervol_preprocess::MaxError;
use supervol_runtime::engines::cells::{CellRule, Pairs};
use supervol_runtime::engines::cpu::Caster;
use supervol_runtime::render::options::{Backend, LevelChoice};
use supervol_runtime::stream::classify::Skipping;
use supervol_scene::image::GREY_LEVELS;

use crate::comparison::{Accumulation, Classification, GradientOperator, Offset, Reconstruction, Rule, Sampling};
use crate::scenes::{Look, Shading, Shape, Storage};

/// Looks of a scene on which a method is measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum On {
    /// All looks.
    Every,
    /// Looks with shading.
    Shaded,
    /// `smooth` and `smooth shaded`.
    Smooth,
}

/// Method of integration along rays.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Integrated {
    /// Cell by cell, in packets, controlled by the method's requested error.
    Default,
    /// Cell by cell, one ray at a time.
    Cells(CellRule),
    /// Sample by sample, a method of comparison.
    Sampled(Sampling),
}

impl Integrated {
    /// The default integration.
    pub const DEFAULT: Self = Self::Default;

    /// The ray caster of this integration.
    #[must_use]
    pub fn caster(self) -> Caster {
        match self {
            Self::Default => Caster::DEFAULT,
            Self::Cells(rule) => Caster::Cells(rule),
            Self::Sampled(sampling) => sampling.caster(),
        }
    }
}

/// One method with its parameters.
#[derive(Debug, Clone, PartialEq)]
pub struct MethodSpec {
    /// Family, as in tables and legends.
    pub method: &'static str,
    /// Parameters that identify the method within its family.
    pub parameters: String,
    /// Looks on which the method is measured.
    pub on: On,
    /// Backend that casts the rays.
    pub backend: Backend,
    /// Method of integration.
    pub integration: Integrated,
    /// `--max-error`, grey levels of 255; only packets use it.
    pub max_error_grey_levels: f64,
    /// Level of detail.
    pub level: LevelChoice,
    /// Empty-space skipping, on or off.
    pub skipping: Skipping,
    /// Storage of the voxels.
    pub storage: Storage,
    /// Codec of the bricks.
    pub codec: CodecChoice,
    /// Largest allowed error of a stored voxel.
    pub voxel_error: MaxError,
    /// Whether these are the default settings.
    pub is_default: bool,
}

impl MethodSpec {
    /// The default settings without a GPU.
    #[must_use]
    pub fn default_method() -> Self {
        Self {
            method: DEFAULT,
            parameters: aimed_at(DEFAULT_ERROR),
            on: On::Every,
            backend: Backend::Cpu,
            integration: Integrated::DEFAULT,
            max_error_grey_levels: DEFAULT_ERROR,
            level: LevelChoice::Auto,
            skipping: Skipping::On,
            storage: Storage::Float,
            codec: CodecChoice::Smallest,
            voxel_error: MaxError::Exact,
            is_default: true,
        }
    }

    fn variant(method: &'static str, parameters: impl Into<String>) -> Self {
        Self { method, parameters: parameters.into(), is_default: false, ..Self::default_method() }
    }

    fn sampled(method: &'static str, parameters: impl Into<String>, sampling: Sampling) -> Self {
        Self { integration: Integrated::Sampled(sampling), ..Self::variant(method, parameters) }
    }

    fn on(self, on: On) -> Self {
        Self { on, ..self }
    }

    /// The requested error as a fraction of full scale; `None` for methods without error control.
    #[must_use]
    pub fn max_error(&self) -> Option<f64> {
        let is_aimed = self.integration == Integrated::Default && self.backend == Backend::Cpu;
        is_aimed.then_some(self.max_error_grey_levels / GREY_LEVELS)
    }

    /// Whether its pictures state an error from the exact picture of the stored floats.
    #[must_use]
    pub fn states_its_error(&self) -> bool {
        let is_stored_exactly = self.storage == Storage::Float && self.voxel_error == MaxError::Exact;
        self.integration == Integrated::Default && is_stored_exactly
    }

    /// Whether the method is measured on this look.
    #[must_use]
    pub fn is_for(&self, look: Look) -> bool {
        match self.on {
            On::Every => true,
            On::Shaded => look.shading == Shading::On,
            On::Smooth => look.shape == Shape::Smooth,
        }
    }
}

/// Family of the default, at any requested error.
pub const DEFAULT: &str = "default";
/// Family of the default's rule, one ray at a time.
pub const CELLS: &str = "cells, adaptive";
/// Requested errors of the default, grey levels of 255, from cheap to accurate.
pub const ERRORS: [f64; 7] = [8.0, 4.0, 2.0, 1.0, DEFAULT_ERROR, 0.25, 0.1];
/// The default of `--max-error`, grey levels of 255.
pub const DEFAULT_ERROR: f64 = 0.5;
/// Sample distances of the methods of comparison, in voxels.
const STEPS: [(f64, &str); 5] = [(2.0, "2"), (1.0, "1"), (0.5, "1/2"), (0.25, "1/4"), (0.125, "1/8")];
/// Step at which operators are compared, in voxels: so small that its own error does not hide theirs.
const FINE_STEP: f64 = 0.25;

/// All methods.
#[must_use]
pub fn methods() -> Vec<MethodSpec> {
    let groups = [defaults(), cells(), sampled(), operators(), termination(), levels(), stores(), skipping_and_gpu()];
    groups.into_iter().flatten().collect()
}

/// The parameter text of an error in grey levels, as `--max-error` takes it.
#[must_use]
pub fn aimed_at(grey_levels: f64) -> String {
    format!("--max-error {grey_levels}/255")
}

fn defaults() -> Vec<MethodSpec> {
    let spec = |grey_levels: f64| MethodSpec {
        max_error_grey_levels: grey_levels,
        is_default: grey_levels == DEFAULT_ERROR,
        ..MethodSpec::variant(DEFAULT, aimed_at(grey_levels))
    };
    ERRORS.map(spec).into()
}

fn cells() -> Vec<MethodSpec> {
    let rule = |pairs| Integrated::Cells(CellRule { pairs, ..CellRule::DEFAULT });
    let adaptive = [0.25, 0.5, 1.0, 2.0, 4.0].map(|density| MethodSpec {
        integration: rule(Pairs::Adaptive { density }),
        ..MethodSpec::variant(CELLS, format!("density {density}"))
    });
    let fixed = [1, 2, 4, 8].map(|pairs| MethodSpec {
        integration: rule(Pairs::Fixed(pairs)),
        ..MethodSpec::variant("cells, fixed", format!("{pairs} Gauss pairs a piece"))
    });
    adaptive.into_iter().chain(fixed).collect()
}

/// Equal steps, by each rule.
fn sampled() -> Vec<MethodSpec> {
    let base = Sampling::default();
    let jitter = Offset::Jittered { frame: 0 };
    let families = [
        ("midpoint samples", Sampling { rule: Rule::Midpoint, ..base }),
        ("left samples", Sampling { rule: Rule::LeftRiemann, ..base }),
        ("pre-integrated", Sampling { rule: Rule::PreIntegrated, ..base }),
        ("pre-integrated, no self-attenuation", Sampling { rule: Rule::PreIntegratedNeglecting, ..base }),
        ("pre-classified", Sampling { classification: Classification::Pre, ..base }),
        ("midpoint samples, jittered", Sampling { offset: jitter, ..base }),
        ("opacity not corrected for the step", Sampling { rule: Rule::LinearOpacity, ..base }),
    ];
    let at_steps = |(family, sampling): (&'static str, Sampling)| {
        STEPS.map(|(step_voxels, name)| {
            MethodSpec::sampled(family, format!("step {name} voxel"), Sampling { step_voxels, ..sampling })
        })
    };
    families.into_iter().flat_map(at_steps).collect()
}

/// Reconstruction, gradients and accumulation precision, at one fine step.
fn operators() -> Vec<MethodSpec> {
    let base = Sampling { step_voxels: FINE_STEP, ..Sampling::default() };
    let kinds = [
        ("nearest", Reconstruction::Nearest),
        ("trilinear", Reconstruction::Trilinear),
        ("trilinear, 8-bit fractions", Reconstruction::TrilinearByteFractions),
        ("Catmull-Rom", Reconstruction::CatmullRom),
        ("cubic B-spline, prefiltered", Reconstruction::CubicBSpline),
    ];
    let reconstructions = kinds.map(|(name, reconstruction)| {
        let sampling = Sampling { reconstruction, ..base };
        let spec = MethodSpec::sampled("reconstruction", format!("{name}, step 1/4 voxel"), sampling).on(On::Smooth);
        // A spline may leave the range of its voxels, but skipping relies on that range.
        match reconstruction {
            Reconstruction::CatmullRom => MethodSpec { skipping: Skipping::Off, ..spec },
            Reconstruction::CubicBSpline => {
                MethodSpec { skipping: Skipping::Off, storage: Storage::SplineCoefficients, ..spec }
            }
            _ => spec,
        }
    });
    let kinds = [
        ("central differences", GradientOperator::Central),
        ("intermediate differences", GradientOperator::Intermediate),
        ("Sobel", GradientOperator::Sobel),
    ];
    let gradients = kinds.map(|(name, gradient)| {
        let sampling = Sampling { gradient, ..base };
        MethodSpec::sampled("gradient operator", format!("{name}, step 1/4 voxel"), sampling).on(On::Shaded)
    });
    let kinds = [
        ("8-bit", Accumulation::Byte),
        ("half", Accumulation::Half),
        ("single", Accumulation::Single),
        ("double", Accumulation::Double),
    ];
    let accumulations = kinds.map(|(name, accumulation)| {
        let sampling = Sampling { accumulation, ..base };
        MethodSpec::sampled("accumulation", format!("{name}, step 1/4 voxel"), sampling).on(On::Smooth)
    });
    reconstructions.into_iter().chain(gradients).chain(accumulations).collect()
}

fn termination() -> Vec<MethodSpec> {
    let limits = [0.95, 0.99, 0.998, 0.9995];
    let named = limits.map(|limit| (limit, format!("at opacity {limit}")));
    let rules = named.into_iter().chain([(f64::INFINITY, "never".into())]);
    let spec = |(termination_opacity, name): (f64, String)| MethodSpec {
        integration: Integrated::Cells(CellRule { termination_opacity, ..CellRule::DEFAULT }),
        ..MethodSpec::variant("early ray termination", name)
    };
    rules.map(spec).collect()
}

fn levels() -> Vec<MethodSpec> {
    let spec = |level: u8| MethodSpec {
        level: LevelChoice::Fixed(Lod(level)),
        ..MethodSpec::variant("level of detail", format!("level {level}"))
    };
    (0..3).map(spec).collect()
}

/// Codecs of bricks and storage of voxels.
fn stores() -> Vec<MethodSpec> {
    let codecs = [
        ("raw", CodecChoice::Only(Codec::Raw)),
        ("run lengths", CodecChoice::Only(Codec::Rle)),
        ("Zstandard", CodecChoice::Only(Codec::Zstd)),
        ("smallest, brick by brick", CodecChoice::Smallest),
    ];
    let codecs = codecs.map(|(name, codec)| MethodSpec { codec, ..MethodSpec::variant("codec", name) });
    let bounded = [0.1, 1.0].map(|percent| MethodSpec {
        voxel_error: MaxError::Percent(percent),
        ..MethodSpec::variant("bounded codec", format!("voxels within {percent} % of the range"))
    });
    let kinds = [("8-bit", Storage::Byte), ("16-bit", Storage::Word), ("float", Storage::Float)];
    let storages = kinds.map(|(name, storage)| MethodSpec { storage, ..MethodSpec::variant("storage", name) });
    codecs.into_iter().chain(bounded).chain(storages).map(|spec| spec.on(On::Smooth)).collect()
}

fn skipping_and_gpu() -> Vec<MethodSpec> {
    vec![
        MethodSpec { skipping: Skipping::Off, ..MethodSpec::variant("without skipping", "skipping off") },
        MethodSpec { backend: Backend::Gpu, ..MethodSpec::variant("GPU backend", "cell by cell") }.on(On::Smooth),
    ]
}

#[cfg(test)]
mod tests {
    use supervol_runtime::render::options::RenderOptions;

    use super::*;

    #[test]
    fn names_are_unique_and_exactly_one_method_is_the_default() {
        let all = methods();
        for (i, a) in all.iter().enumerate() {
            for b in &all[..i] {
                assert!((a.method, &a.parameters) != (b.method, &b.parameters), "{} {} twice", a.method, a.parameters);
            }
        }
        let defaults: Vec<_> = all.iter().filter(|m| m.is_default).collect();
        assert_eq!(defaults.len(), 1);
        assert_eq!(defaults[0], &MethodSpec::default_method());
        assert_eq!(defaults[0].max_error(), Some(RenderOptions::default().max_error));
        let curve: Vec<f64> = all.iter().filter(|m| m.method == DEFAULT).filter_map(MethodSpec::max_error).collect();
        assert!(curve.len() == ERRORS.len() && curve.is_sorted_by(|a, b| a > b), "{curve:?}");
    }

    #[test]
    fn methods_of_comparison_run_on_the_cpu() {
        for m in methods() {
            assert!(m.integration == Integrated::DEFAULT || m.backend == Backend::Cpu, "{} {}", m.method, m.parameters);
        }
    }
}
