// Tangled from chapters/python.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! The compiled half of the Python package `litpt`.

mod job;
mod matrix;
mod mesh;
mod rays;
mod rendering;

use std::panic::{self, AssertUnwindSafe};
use std::sync::{Arc, Mutex};

use litpt::cli::options::{self, Options};
use litpt::cli::run::main_with;
use litpt::error::Error;
use litpt::host::Host;
use litpt::image::Format;
use litpt::inputs::{Inputs, read_sky};
use litpt::integrator::SingleProcess;
use litpt::plan::{Plan, Product};
use litpt::world::{Geometry, World};
use numpy::{PyReadonlyArray1, PyReadonlyArray2};
use pyo3::exceptions::{
    PyKeyboardInterrupt, PyMemoryError, PyOSError, PyRuntimeError,
    PyValueError,
};
use pyo3::prelude::*;
use rayon::ThreadPoolBuilder;

#[pymodule]
mod _core {
    #[pymodule_export]
    use super::{Scene, job::Job, main, matrix::matrix};
    #[pymodule_export]
    use super::{matrix::Sky, rendering::Rendering};
    #[pymodule_export]
    #[allow(non_upper_case_globals)]
    const version: &str = env!("CARGO_PKG_VERSION");
}

/// Runs `pt` with these words, the first of which is its name.
#[pyfunction]
fn main(py: Python, words: Vec<std::ffi::OsString>) -> u8 {
    py.detach(|| main_with(words, &SingleProcess))
}

/// An error of the library as Python has it.
fn refused(error: Error) -> PyErr {
    let text = options::by_option(&error);
    let number = text.split("(os error ").nth(1);
    let number = number.and_then(|rest| rest.split(')').next());
    if let Some(number) = number.and_then(|n| n.parse::<i32>().ok()) {
        return PyOSError::new_err((number, text));
    }
    match error {
        Error::File { .. } | Error::Kept { .. } => PyOSError::new_err(text),
        Error::Memory(_) => PyMemoryError::new_err(text),
        _ => PyValueError::new_err(text),
    }
}

/// The plan of some options, as `pt` has them.
fn options(words: Vec<String>) -> PyResult<Plan> {
    let words = ["pt".to_owned()].into_iter().chain(words);
    let options = Options::parse(words);
    let plan = options.and_then(|options| options.plan(None, false));
    plan.map_err(|error| match error {
        options::Error::Failure(error) => refused(error),
        other => PyValueError::new_err(other.to_string()),
    })
}

/// The plan of a run, which keeps what a picture and a state need.
fn plan(words: Vec<String>) -> PyResult<Plan> {
    let mut plan = options(words)?;
    let exr = (Product::Image(Format::Exr), "image.exr".into());
    let state = (Product::State, "run.litpt".into());
    let exr = plan.camera().map(|_| exr);
    plan.outputs.files = exr.into_iter().chain([state]).collect();
    Ok(plan)
}

/// Unwinds a run that is cancelled before it renders.
struct Cancelled;

/// Does some work on threads of its own, which end with it. A panic does not
/// cross into Python.
fn on_threads<T: Send>(
    threads: Option<u64>,
    work: impl FnOnce() -> Result<T, Error> + Send,
) -> PyResult<T> {
    let count = threads.unwrap_or(0) as usize;
    let pool = ThreadPoolBuilder::new().num_threads(count);
    let pool = pool.thread_name(|_| "litpt".to_owned()).build();
    let pool = pool.map_err(|e| PyRuntimeError::new_err(e.to_string()))?;
    let work = AssertUnwindSafe(|| pool.install(work));
    match panic::catch_unwind(work) {
        Ok(done) => done.map_err(refused),
        Err(cause) if cause.is::<Cancelled>() => {
            Err(PyKeyboardInterrupt::new_err(()))
        }
        Err(_) => Err(PyRuntimeError::new_err("a fault of litpt")),
    }
}

/// A scene, built when it is first needed.
#[pyclass(frozen, module = "litpt._core")]
struct Scene(Arc<SceneData>);

pub struct SceneData {
    inputs: Inputs,
    geometry: Mutex<Option<Arc<Geometry>>>,
}

impl SceneData {
    /// The world of a plan; only the first one builds the geometry.
    fn world(
        &self,
        plan: &Plan,
        inputs: Inputs,
        host: Host,
    ) -> Result<World, Error> {
        let mut built =
            self.geometry.lock().unwrap_or_else(|it| it.into_inner());
        if let Some(geometry) = built.clone() {
            drop(built);
            return World::sharing(&geometry, plan, inputs, host);
        }
        host.enter("reading the mesh", None);
        let world = World::new(plan, inputs, host)?;
        *built = Some(world.geometry.clone());
        Ok(world)
    }

    /// The inputs of a run with these points.
    fn inputs(&self, points: Option<Points>) -> Inputs {
        let inputs = self.inputs.clone();
        let Some((points, normals, sha256)) = points else { return inputs };
        let pairs =
            mesh::vectors(&points).into_iter().zip(mesh::vectors(&normals));
        Inputs { points_sha256: sha256, ..inputs.with_points(pairs) }
    }
}

/// Points, normals, and the SHA-256 of both.
type Points<'py> =
    (PyReadonlyArray2<'py, f64>, PyReadonlyArray2<'py, f64>, String);

#[pymethods]
impl Scene {
    /// A scene of options and of a mesh; of a file, if there is none.
    #[staticmethod]
    fn open(
        py: Python,
        words: Vec<String>,
        mesh: Option<mesh::Arrays>,
        albedos: Option<PyReadonlyArray1<f64>>,
        sha256: String,
    ) -> PyResult<(Self, Vec<String>)> {
        let plan = plan(words)?;
        let warnings = Mutex::new(vec![]);
        let listen = |event| {
            if let litpt::host::Event::Warning(text) = event {
                warnings
                    .lock()
                    .unwrap_or_else(|it| it.into_inner())
                    .push(text);
            }
        };
        let host = Host { listen: &listen, ..Host::default() };
        let albedos = albedos.map_or(vec![], |it| it.as_array().to_vec());
        // Read the mesh and check it
        let mesh = mesh.map(mesh::of).transpose()?;
        let open = || {
            let inputs = match mesh {
                Some(mesh) => Inputs {
                    sky: read_sky(&plan, host)?,
                    ..mesh::filled(mesh).into()
                },
                None => Inputs::read(&plan, host)?,
            };
            let sha256 = inputs.sha256.clone() + &sha256;
            let inputs = Inputs { sha256, albedos, ..inputs };
            mesh::check(&plan, &inputs)?;
            Ok(inputs)
        };
        let inputs = py.detach(|| on_threads(plan.threads, open))?;
        let scene = SceneData { inputs, geometry: Mutex::default() };
        let scene = Self(scene.into());
        Ok((scene, warnings.into_inner().unwrap_or_default()))
    }

    /// Begins a run of these options.
    fn start(
        &self,
        words: Vec<String>,
        points: Option<Points>,
    ) -> PyResult<job::Job> {
        let (scene, inputs) = (self.0.clone(), self.0.inputs(points));
        job::Job::start(scene, plan(words)?, inputs)
    }

    /// The result whose parts have these states.
    fn restore(
        &self,
        py: Python,
        words: Vec<String>,
        points: Option<Points>,
        states: Vec<Vec<u8>>,
    ) -> PyResult<rendering::Rendering> {
        let (plan, inputs) = (plan(words)?, self.0.inputs(points));
        py.detach(|| {
            on_threads(plan.threads, || {
                let world = self.0.world(&plan, inputs, Host::default())?;
                rendering::Rendering::restore(world, states)
            })
        })
    }

    /// The first hits of rays: numbers of faces, -1 for none, and places.
    fn hits<'py>(
        &self,
        py: Python<'py>,
        words: Vec<String>,
        origins: PyReadonlyArray2<'py, f64>,
        directions: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<rays::Hits<'py>> {
        rays::hits(py, &self.0, plan(words)?, &origins, &directions)
    }

    /// The arrays of the mesh.
    fn arrays<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        mesh::parts(py, &self.0.inputs.mesh)
    }
}
