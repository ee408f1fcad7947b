// Tangled from chapters/plan.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! What a run does, with every default resolved.
//!
//! A plan is a value: two equal plans of equal files make the same samples.
//!
//! ```
//! use litpt::host::{Host, Interrupt};
//! use litpt::inputs::Inputs;
//! use litpt::plan::{Budget, Plan};
//! use litpt::{run::Run, scene::read_obj, world::World};
//!
//! let mesh = read_obj(b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")?;
//! let mut plan = Plan { budget: Budget::samples(4), ..Plan::default() };
//! plan.surfaces.albedo = 0.5;
//! let host = Host::default();
//! let world = World::new(&plan, Inputs::from(mesh), host)?;
//! let run = Run::new(&world, &plan, host)?;
//! let image = run.render(&Interrupt::default())?;
//! assert_eq!(image.film.area(), 320 * 240);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::fmt::Display;
use std::os::unix::ffi::OsStringExt;
use std::path::{Path, PathBuf};

use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::bvh::Isa;
use crate::camera::{View, Viewpoint};
use crate::compare::display::Exposure;
use crate::error::{Error, Result};
use crate::film::{MAX_SIDE, SIDE, Window};
use crate::image::Format;
use crate::key::{Part, whole_window};
use crate::materials::Band;
use crate::materials::glass::{Bsdf, CLEAREST};
use crate::matrix::MatrixFormat;
use crate::output::descriptor;
pub use crate::render::choose::Budget;
use crate::render::choose::{Method, default_samples};
use crate::report::Kind;
use crate::scene::Mesh;
use crate::sensor::Side;
use crate::sensor::table::TableFormat;
use crate::sky::{Cover, Sun};
use crate::tally::{Surface, Tally};

/// What a run does.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Plan {
    /// The file of the scene; `-` is standard input.
    pub scene: PathBuf,
    /// What senses the light.
    pub sensor: SensorPlan,
    /// The direction that is up for a camera, and in which the sky is; if
    /// none is given, z.
    pub up: Option<DVec3>,
    /// What surfaces reflect.
    pub surfaces: SurfacePlan,
    /// Where light comes from.
    pub sky: SkyPlan,
    /// What the light is sorted by, if it is not only summed.
    #[serde(default)]
    pub tally: Option<Tally>,
    /// When the run ends.
    pub budget: Budget,
    /// The part of the run that is rendered, if it is not all of it.
    pub part: Option<Part>,
    /// The method; none if a pilot is to choose one.
    pub method: Option<Method>,
    /// The seed of all random numbers.
    pub seed: u64,
    /// The state of another part, whose trained cache is used.
    pub cache: Option<PathBuf>,
    /// Whether work that cannot change the image is left out.
    pub shortcuts: bool,
    /// The number of threads; none for all cores.
    pub threads: Option<u64>,
    /// The instructions to trace rays with; none for the fastest that this
    /// processor has.
    pub isa: Option<Isa>,
    /// An image of the same view, to compute true errors from.
    pub reference: Option<PathBuf>,
    /// The files of the run.
    pub outputs: Outputs,
}

/// A picture of a whole scene from a corner, with one sample a pixel.
impl Default for Plan {
    fn default() -> Self {
        Self {
            scene: PathBuf::from("-"),
            sensor: SensorPlan::Camera(CameraPlan::default()),
            up: None,
            surfaces: SurfacePlan {
                albedo: 1.,
                named: vec![],
                materials: Some(false),
                band: None,
                transmitting: vec![],
                glass: false,
            },
            sky: SkyPlan {
                cover: Cover::Uniform,
                zenith: None,
                sun: None,
                ground_glow: None,
                ground: None,
                direct: None,
            },
            tally: None,
            budget: Budget::samples(default_samples(false)),
            part: None,
            method: None,
            seed: 0,
            cache: None,
            shortcuts: true,
            threads: None,
            isa: None,
            reference: None,
            outputs: Outputs::default(),
        }
    }
}

/// What senses the light of a scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum SensorPlan {
    /// A camera.
    Camera(CameraPlan),
    /// The points of this file.
    Points(PathBuf),
    /// The faces of the scene, on some sides.
    Faces {
        /// Which sides.
        side: Side,
        /// Whether the light that leaves them is computed, and not what
        /// arrives.
        radiosity: bool,
    },
    /// The vertices of the scene.
    Vertices,
}

/// A camera and its image.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct CameraPlan {
    /// Width and height of the whole image, in pixels.
    pub resolution: (u32, u32),
    /// The window that is rendered, if it is not the whole image.
    pub crop: Option<Window>,
    /// Where the camera stands.
    pub stand: Stand,
    /// Vertical field of view in degrees.
    pub fov: f64,
    /// The radiance that is seen behind the scene instead of the sky.
    pub background: Option<f64>,
}

/// Where a camera stands.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Stand {
    /// At a position, looking at a target.
    At(DVec3, DVec3),
    /// Outside, on a side from which it shows all of the scene, turned
    /// counter-clockwise about the zenith and raised by so many degrees.
    Outside(Viewpoint, [f64; 2]),
}

impl Default for CameraPlan {
    fn default() -> Self {
        Self {
            resolution: (320, 240),
            crop: None,
            stand: Stand::Outside(Viewpoint::Iso, [0.; 2]),
            fov: 70.,
            background: None,
        }
    }
}

impl CameraPlan {
    /// The window that is rendered.
    pub fn window(&self) -> Window {
        whole_window(self.resolution, self.crop)
    }

    /// Whether its position is given.
    pub fn is_placed(&self) -> bool {
        matches!(self.stand, Stand::At(..))
    }

    /// Width over height.
    pub fn aspect(&self) -> f64 {
        let (width, height) = self.resolution;
        f64::from(width) / f64::from(height)
    }

    /// The view with this direction up; outside the scene its position is
    /// still to be found.
    pub fn view(&self, up: DVec3) -> View {
        let (position, target) = match self.stand {
            Stand::At(position, target) => (position, target),
            Stand::Outside(..) => (DVec3::ZERO, DVec3::Y),
        };
        View { position, target, up, fov: self.fov }
    }
}

/// What surfaces reflect; albedos are in [0, 1].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SurfacePlan {
    /// The albedo of each surface without one of its own.
    pub albedo: f64,
    /// Albedos of materials, groups and objects by name.
    pub named: Vec<(String, f64)>,
    /// Whether materials have the albedos of their libraries; none to use
    /// those that can be read.
    pub materials: Option<bool>,
    /// The band of the materials; none for the luminance.
    pub band: Option<Band>,
    /// What materials, groups and objects let through, by name.
    #[serde(default)]
    pub transmitting: Vec<(String, Bsdf)>,
    /// Whether transparent materials are glass.
    #[serde(default)]
    pub glass: bool,
}

/// Where light comes from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SkyPlan {
    /// How the radiance of the sky is distributed.
    pub cover: Cover,
    /// The direction to its middle; none for the axis nearest to up.
    pub zenith: Option<DVec3>,
    /// Where the sun is, around which some skies are brighter.
    #[serde(default)]
    pub sun: Option<Sun>,
    /// The albedo of an endless ground that is seen below the horizon, lit by
    /// the whole sky, if there is one.
    #[serde(default)]
    pub ground_glow: Option<f64>,
    /// The albedo of an endless ground below the scene, if there is one.
    pub ground: Option<f64>,
    /// The irradiance that the sun adds on a surface that faces it, in units
    /// of that of a horizontal one under the sky alone.
    #[serde(default)]
    pub direct: Option<f64>,
}

/// What a file of a run holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Product {
    /// The image; a PNG may show previews.
    Image(Format),
    /// A report of this kind.
    Report(Kind),
    /// The values of receivers, in this format.
    Table(TableFormat),
    /// The entries of a tally, in this format.
    Matrix(MatrixFormat),
    /// The state of the run.
    State,
}

impl Product {
    /// Whether a filter may change what it shows.
    pub fn is_picture(self) -> bool {
        use Format::{Exr, Png};
        matches!(self, Self::Image(Png | Exr) | Self::Report(Kind::Html))
    }

    /// Whether it names the scene by its hash.
    fn has_hash(self) -> bool {
        !matches!(self, Self::Image(format) if format != Format::Exr)
    }
}

/// What a run writes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Outputs {
    /// Files and their contents.
    pub files: Vec<(Product, PathBuf)>,
    /// Whether files that exist are replaced.
    pub force: bool,
    /// Files that the run has written before it was resumed.
    pub replaced: Vec<PathBuf>,
    /// Seconds between two states.
    pub checkpoint_interval: f64,
    /// Whether PNG files are written while the image is rendered.
    pub preview: bool,
    /// By how much PNG files and pages are brighter, if it is given.
    pub exposure: Option<Exposure>,
    /// Whether pictures are filtered.
    pub filter: bool,
    /// Whether view factors are made reciprocal and closed.
    #[serde(default)]
    pub closed: bool,
    /// The root mean square error of the picture, relative to the mean of
    /// all but the sky, at which the run ends.
    #[serde(default)]
    pub picture_error: Option<f64>,
    /// What was chosen for pictures, in words.
    #[serde(skip)]
    pub defaults: String,
}

impl Default for Outputs {
    fn default() -> Self {
        Self {
            files: vec![],
            force: false,
            replaced: vec![],
            checkpoint_interval: 60.,
            preview: false,
            exposure: None,
            filter: true,
            closed: false,
            picture_error: None,
            defaults: String::new(),
        }
    }
}

impl Outputs {
    /// The files with some contents.
    pub fn of(
        &self,
        is_meant: impl Fn(Product) -> bool,
    ) -> impl Iterator<Item = &Path> {
        let files = self.files.iter();
        let meant = files.filter(move |(product, _)| is_meant(*product));
        meant.map(|(_, path)| path.as_path())
    }
}

impl CameraPlan {
    /// Checks that there is such an image.
    fn check(&self) -> Result<()> {
        let (width, height) = self.resolution;
        let size = format!("{width}x{height}");
        let is_side = |n| (1..=MAX_SIDE).contains(&n);
        let is_image = is_side(width) && is_side(height);
        let wanted = "expected sides from 1 to 16384";
        require(is_image, "resolution", &size, wanted)?;
        let grey = self.background.unwrap_or(0.);
        let wanted = "expected a radiance from 0 to 1e9";
        require((0. ..=1e9).contains(&grey), "background", grey, wanted)?;
        let window = self.window();
        let Window { corner: (x, y), size: (w, h) } = window;
        let fits = |at, n, side| at < side && 0 < n && n <= side - at;
        let is_within = fits(x, w, width) && fits(y, h, height);
        let beyond =
            format!("does not lie within the image of {size} pixels");
        require(is_within, "crop", String::from(window), &beyond)
    }
}

/// Returns an error with a reason in words unless a value is valid.
pub(crate) fn require(
    is_valid: bool,
    name: &'static str,
    value: impl Display,
    reason: &str,
) -> Result<()> {
    let named = format!("{name} {value}");
    let fault = format!("{}: {reason}", named.trim_end());
    is_valid.then_some(()).ok_or(Error::value(name, value, fault))
}

impl Plan {
    /// The camera, if there is one.
    pub fn camera(&self) -> Option<&CameraPlan> {
        match &self.sensor {
            SensorPlan::Camera(camera) => Some(camera),
            _ => None,
        }
    }

    /// The file of the points, if there is one.
    pub fn points(&self) -> Option<&Path> {
        match &self.sensor {
            SensorPlan::Points(path) => Some(path),
            _ => None,
        }
    }

    /// Whether all of its files are pictures, on the disk, of a whole image
    /// without a reference.
    pub fn shows_only_pictures(&self) -> bool {
        let is_picture = |(product, path): &(Product, PathBuf)| {
            product.is_picture()
                && *product != Product::Image(Format::Exr)
                && descriptor(path).is_none()
        };
        let files = &self.outputs.files;
        let is_alone = self.reference.is_none() && self.cache.is_none();
        let is_whole = self.part.is_none() && is_alone;
        is_whole && !files.is_empty() && files.iter().all(is_picture)
    }

    /// Whether it shows a picture that is filtered.
    pub fn filters(&self) -> bool {
        let has_picture =
            self.outputs.of(Product::is_picture).next().is_some();
        let has_noise = self.method == Some(Method::Reference);
        let is_image = has_picture && self.camera().is_some();
        is_image && self.outputs.filter && !has_noise
    }

    /// The instructions to trace rays with.
    pub fn isa(&self) -> Isa {
        self.isa.unwrap_or_else(Isa::best)
    }

    /// The name of the scene, for people.
    pub fn scene_name(&self) -> String {
        input_name(&self.scene)
    }

    /// Whether a file names the scene by its hash.
    pub fn names_scene(&self) -> bool {
        self.cache.is_some()
            || self.reference.is_some()
            || self.outputs.files.iter().any(|(p, _)| p.has_hash())
    }

    /// Whether surfaces let light through.
    fn transmits(&self) -> bool {
        self.surfaces.glass || !self.surfaces.transmitting.is_empty()
    }

    /// Whether both sides of faces are receivers.
    pub fn has_sides(&self) -> bool {
        let SensorPlan::Faces { side, .. } = self.sensor else {
            return false;
        };
        side == Side::Both
    }

    /// Whether the plan states where up is.
    pub fn says_up(&self) -> bool {
        self.up.or(self.sky.zenith).is_some()
    }

    /// Sets the up axis that the faces of a mesh suggest, if none was given.
    pub fn look_up(&mut self, mesh: &Mesh) {
        if !self.says_up() {
            self.up = mesh.up();
        }
    }

    /// Checks that the plan can be rendered.
    ///
    /// # Errors
    /// The first invalid value.
    pub fn check(&self) -> Result<()> {
        let named = self.surfaces.named.iter().map(|(_, albedo)| *albedo);
        let albedos =
            named.chain(self.sky.ground).chain([self.surfaces.albedo]);
        let albedos = albedos.chain(self.sky.ground_glow);
        for albedo in albedos {
            let is_valid = (0. ..=1.).contains(&albedo);
            let wanted = "expected a number from 0 to 1";
            require(is_valid, "albedo", albedo, wanted)?;
        }
        self.sky.check()?;
        self.check_transmission()?;
        let Budget { samples, time, error } = self.budget;
        let (samples, time) = (samples.unwrap_or(1), time.unwrap_or(0.));
        require(samples > 0, "samples", samples, "expected at least 1")?;
        let wanted = "expected seconds, not less than 0";
        require(time >= 0., "time", time, wanted)?;
        let error = error.map_or(1., |(error, _)| error);
        require(error > 0., "error", error, "expected more than 0")?;
        self.camera().map_or(Ok(()), CameraPlan::check)?;
        self.tally.as_ref().map_or(Ok(()), |it| self.check_tally(it))?;
        let is_square = self.tally
            == Some(Tally::ViewFactors(Surface::Faces))
            && matches!(self.sensor, SensorPlan::Faces { .. });
        let wanted = "needs faces as rows and as columns of view factors";
        let closed = self.outputs.closed;
        require(!closed || is_square, "closed", "", wanted)?;
        self.part.map_or(Ok(()), |part| self.check_part(part))
    }

    /// Checks what surfaces let through.
    fn check_transmission(&self) -> Result<()> {
        let is_opaque = !self.transmits();
        let leaves = matches!(
            self.sensor,
            SensorPlan::Faces { radiosity: true, .. }
        );
        let wanted = "is not computed where surfaces let light through \
                      (--glass, --transmit)";
        require(is_opaque || !leaves, "radiosity", "", wanted)?;
        for (name, bsdf) in &self.surfaces.transmitting {
            let (is_valid, wanted) = match bsdf {
                Bsdf::Transmitter([back, on]) => (
                    *back >= 0. && *on >= 0. && back + on <= 1.,
                    TRANSMITTER,
                ),
                bsdf => {
                    let part = bsdf.transmittance();
                    ((0. ..=CLEAREST).contains(&part), GLASS)
                }
            };
            let (option, value) = bsdf.typed(name);
            require(is_valid, option, value, wanted)?;
        }
        self.check_names()
    }

    /// Checks that no name is given two kinds of surfaces.
    fn check_names(&self) -> Result<()> {
        let SurfacePlan { named, transmitting, .. } = &self.surfaces;
        let opaque = named.iter().map(|(n, a)| (n, Bsdf::Diffuse(*a)));
        let clear = transmitting.iter().map(|(name, bsdf)| (name, *bsdf));
        let mut given = BTreeMap::new();
        for (name, bsdf) in clear.chain(opaque) {
            let (option, value) = bsdf.typed(name);
            let first =
                given.entry(name).or_insert((option, value.clone()));
            let (other, there) = &*first;
            let fault =
                format!("contradicts --{other} {there}; give one of them");
            require(*other == option, option, value, &fault)?;
        }
        Ok(())
    }

    /// Checks that the receivers can have this tally.
    fn check_tally(&self, tally: &Tally) -> Result<()> {
        let is_uniform = self.sky.cover == Cover::Uniform
            && self.sky.ground_glow.is_none();
        let has_patches = !matches!(tally, Tally::Derivative(_));
        let transmits = self.transmits();
        let is_fit = match self.method {
            Some(Method::Gather) => tally.can_gather(),
            method => method.is_none_or(|m| m == Method::Sobol),
        };
        let error = self.budget.error;
        let is_relative = error.is_some_and(|(_, norm)| norm.relative);
        let (name, value) = tally.named();
        let fault = match &self.sensor {
            SensorPlan::Camera(_) => "needs receivers, points or faces",
            SensorPlan::Vertices if tally.is_of_surfaces() => {
                "needs points or faces, and not vertices"
            }
            SensorPlan::Faces { radiosity: true, .. } => {
                "sorts what arrives, and not the radiosity"
            }
            _ if self.sky.direct.is_some() => NO_SUN,
            _ if transmits && tally.is_of_surfaces() => NOT_THROUGH,
            _ if transmits && !has_patches => NO_SHEET,
            _ if has_patches && !is_uniform => {
                "needs the uniform sky without a glow, whose light does not matter"
            }
            _ if !is_fit => METHODS[usize::from(tally.can_gather())],
            _ if tally.is_of_surfaces() && is_relative => {
                "needs an absolute error: entries may be 0"
            }
            _ => match tally {
                Tally::SkyPatches(1 | 2 | 4) => return Ok(()),
                Tally::SkyPatches(_) => "expected 1, 2 or 4",
                _ => return Ok(()),
            },
        };
        require(false, name, value, fault)
    }

    /// Checks that the part of the run exists.
    fn check_part(&self, part: Part) -> Result<()> {
        let ((from, to), (k, n)) = (part.samples, part.band);
        let range = format!("{from}..{to}");
        let is_range = from <= to && to <= part.of;
        let wanted = "expected samples of the run, in order";
        require(is_range, "part", range, wanted)?;
        let band = format!("{k}/{n}");
        let is_band = 1 <= k && k <= n;
        require(
            is_band,
            "band",
            &band,
            "expected a band of tiles, from 1",
        )?;
        let Some(camera) = self.camera() else { return Ok(()) };
        let rows = camera.window().tile_rows(SIDE);
        let more = format!(
            "the image has {rows} rows of tiles, and not more bands"
        );
        require(n <= rows, "band", band, &more)
    }

    /// The plan as a state holds it, whose files are found from any directory;
    /// it was made in `directory`.
    pub fn saved(&self, directory: &Path) -> Self {
        let mut saved = self.clone();
        for name in saved.names() {
            let full = directory.join(&name).into_os_string().into_vec();
            let text: String = full.into_iter().map(char::from).collect();
            *name = text.into();
        }
        saved
    }

    /// The plan that was saved.
    pub fn restored(mut self) -> Self {
        for name in self.names() {
            let text = name.to_string_lossy();
            let bytes = text.chars().map(|c| c as u8).collect();
            *name = OsString::from_vec(bytes).into();
        }
        self
    }

    /// The names of all files of a run.
    fn names(&mut self) -> impl Iterator<Item = &mut PathBuf> {
        let Self { scene, sensor, sky, cache, reference, outputs, .. } =
            self;
        let points = match sensor {
            SensorPlan::Points(path) => Some(path),
            _ => None,
        };
        let sky = match &mut sky.cover {
            Cover::Matrix(path, _) => Some(path),
            _ => None,
        };
        let Outputs { files, replaced, .. } = outputs;
        let (cache, reference) = (cache.as_mut(), reference.as_mut());
        let read = [Some(scene), points, sky, cache, reference];
        let written = files.iter_mut().map(|(_, path)| path);
        let names =
            read.into_iter().flatten().chain(written).chain(replaced);
        names.filter(|name| !is_dash(name))
    }
}

impl SkyPlan {
    /// Checks that there is such a sky.
    fn check(&self) -> Result<()> {
        let zenith = self.zenith.unwrap_or(DVec3::Z);
        let is_direction = zenith.is_finite() && zenith != DVec3::ZERO;
        let wanted = "expected a finite vector, not zero";
        require(is_direction, "zenith", zenith, wanted)?;
        let named: Result<Cover, String> = self.cover.to_string().parse();
        let fault = named.err().unwrap_or_default();
        require(fault.is_empty(), "sky", &self.cover, &fault)?;
        let is_whole = self.cover == Cover::Sphere;
        let glow = self.ground_glow.filter(|_| is_whole);
        let wanted = "the sphere has its own light below the horizon";
        let named = glow.unwrap_or_default();
        require(glow.is_none(), "ground-glow", named, wanted)?;
        let direct = self.direct.unwrap_or(0.);
        let is_irradiance = (0. ..=1e6).contains(&direct);
        let wanted = "expected an irradiance from 0 to 1e6";
        require(is_irradiance, "direct", format!("{direct:?}"), wanted)?;
        let has_sun = self.direct.is_none() || self.sun.is_some();
        let wanted = "needs the direction to the sun, --sun";
        require(has_sun, "direct", direct, wanted)?;
        let is_lit = self.sun.is_some() || !self.cover.needs_sun();
        let wanted = "needs the direction to the sun, --sun";
        require(is_lit, "sky", &self.cover, wanted)
    }
}

/// Why a tally refuses a method, if it cannot be gathered and if it can.
const METHODS: [&str; 2] = [
    "is sampled by the method sobol alone",
    "is sampled by the methods sobol and gather alone",
];

/// Why a tally refuses the sun.
const NO_SUN: &str = "has no light of a sun, and not --direct";

/// Why view factors refuse what lets light through.
const NOT_THROUGH: &str = "ends at the first surface, and looks through none \
                           (--glass, --transmit)";

/// Why a derivative refuses it.
const NO_SHEET: &str = "follows what surfaces reflect, and not what they \
                        transmit (--glass, --transmit)";

/// What the option for glass takes.
const GLASS: &str = "expected a transmittance from 0 to 0.9183: clear glass \
                     reflects the rest";

/// What the option for diffuse transmitters takes.
const TRANSMITTER: &str = "expected the parts that are reflected and \
                           transmitted, not more than 1 together";

/// The name of an input file, for people.
pub(crate) fn input_name(path: &Path) -> String {
    match is_dash(path) {
        true => "standard input".to_owned(),
        false => path.display().to_string(),
    }
}

/// Whether a name stands for standard input or output.
pub fn is_dash(path: &Path) -> bool {
    path.as_os_str() == "-"
}
