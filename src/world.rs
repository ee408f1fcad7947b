// Tangled from chapters/world.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! A scene that is ready to be rendered: its sensor, its surfaces, its sky,
//! its hierarchy, and the findings about them.
//!
//! ```
//! use litpt::host::Host;
//! use litpt::plan::{Plan, SensorPlan};
//! use litpt::{inputs::Inputs, scene::read_obj, world::World};
//!
//! let mesh = read_obj(b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")?;
//! let sensor = SensorPlan::Vertices;
//! let plan = Plan { sensor, ..Plan::default() };
//! let world = World::new(&plan, Inputs::from(mesh), Host::default())?;
//! assert_eq!(world.subject.sensed.resolution(), (1, 3));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use std::collections::BTreeMap;
use std::iter;
use std::sync::Arc;
use std::time::Instant;

use glam::DVec3;
use rayon::prelude::*;

use crate::analysis::{LitView, SHORTCUTS, SceneAnalysis};
use crate::bvh::{Bvh, GROUND, Intersector, Quality, too_small};
use crate::camera::{Camera, View, direction, typed};
use crate::error::Result;
use crate::film::{Film, SIDE, tile_height};
use crate::host::{Event, Host};
use crate::image::levels::level;
use crate::inputs::{Inputs, read_sky};
use crate::integrator::gather::cache::Grid;
use crate::key::{Framing, ReceiverSource, Sensed, Subject};
use crate::materials::glass::{Bsdf, Pane};
use crate::materials::{
    AlbedoTable, FaceAlbedos, Named, Surfaces, names, nearness,
};
use crate::matrix::Matrix;
use crate::plan::{
    Budget, CameraPlan, Plan, SensorPlan, SkyPlan, Stand, input_name,
    require,
};
use crate::render::choose::{Setup, expected_rays};
use crate::report::{Report, SceneFile, Settings};
use crate::scene::encoding::quoted;
use crate::scene::{Frame, MarkKind, Mesh, Ray, Scene};
use crate::sensor::table::{Shape, Table};
use crate::sensor::{INSIDE, Receivers, Sensor, Side};
use crate::sky::sun::Beam;
use crate::sky::{Cover, Gradation, Patchwork, Sky, Sun};
use crate::tally::{Columns, Surface, Tally};

/// A subject, the hierarchy of its scene, and the findings about both.
pub struct World {
    /// The view, the surfaces and the light.
    pub subject: Subject,
    /// The sensor, which starts the samples.
    pub sensor: Sensor,
    /// The triangles, which several worlds may share.
    pub geometry: Arc<Geometry>,
    /// The work that the scene does not need.
    pub analysis: SceneAnalysis,
    /// The table for the values of receivers.
    table: Option<Table>,
    /// The columns of a tally, if there is one.
    pub columns: Option<Columns>,
    /// The first part of a report: the file, the light, how well the
    /// hierarchy is built, and the seconds of both.
    pub report: Report,
}

impl World {
    /// The view for renderers.
    pub fn view(&self) -> LitView<'_> {
        let Self { subject, sensor, geometry, .. } = self;
        let surfaces = Surfaces::new(&geometry.albedos, subject.ground);
        let (sky, resolution) = (&subject.sky, subject.sensed.resolution());
        LitView { sensor, sky, surfaces, resolution }
    }

    /// The table and the receivers, if there are any.
    pub fn table(&self) -> Option<(&Table, &Receivers)> {
        match (&self.table, &self.sensor) {
            (Some(table), Sensor::Receivers(receivers)) => {
                Some((table, receivers))
            }
            _ => None,
        }
    }

    /// The row of each receiver on the film of a tally, if it has one; none
    /// without a tally.
    pub fn rows(&self) -> Vec<Option<u32>> {
        let (Some(_), Some((_, receivers))) = (&self.columns, self.table())
        else {
            return vec![];
        };
        let mut rows = vec![None; receivers.asked];
        for (&number, y) in receivers.numbers.iter().zip(0..) {
            rows[number as usize] = Some(y);
        }
        rows
    }

    /// The matrix of a tally on a film, if there is one.
    pub fn matrix<'a>(&'a self, film: &'a Film) -> Option<Matrix<'a>> {
        let columns = self.columns.as_ref()?;
        Some(Matrix::new(columns, self.table()?.0, self.rows(), film))
    }

    /// What renderers of this world are made from.
    pub fn setup(&self) -> Setup<'_> {
        let Self { geometry, analysis, .. } = self;
        let (view, columns) = (self.view(), self.columns.as_ref());
        Setup { intersector: &geometry.bvh, view, analysis, columns }
    }
}

/// The triangles of a scene, ready to be traced.
pub struct Geometry {
    /// The map from the coordinates of the file.
    pub frame: Frame,
    /// The hierarchy.
    pub bvh: Bvh,
    /// The faces that the scene has left out.
    pub left_out: [Vec<u32>; 2],
    albedos: AlbedoTable,
    quality: Quality,
}

impl World {
    /// Prepares a scene according to a plan.
    ///
    /// # Errors
    /// The plan does not suit the scene, or there is too little memory.
    pub fn new(plan: &Plan, inputs: Inputs, host: Host) -> Result<Self> {
        inputs.mesh.check()?;
        Self::with(None, plan, inputs, host)
    }

    /// Prepares a scene whose geometry is built. The inputs are those of that
    /// world but for points, and the plan has its surfaces and its light.
    ///
    /// # Errors
    /// The plan does not suit the scene.
    pub fn sharing(
        geometry: &Arc<Geometry>,
        plan: &Plan,
        inputs: Inputs,
        host: Host,
    ) -> Result<Self> {
        Self::with(Some(geometry), plan, inputs, host)
    }

    /// Prepares a scene, which may be built already.
    fn with(
        built: Option<&Arc<Geometry>>,
        plan: &Plan,
        inputs: Inputs,
        host: Host,
    ) -> Result<Self> {
        let began = Instant::now();
        plan.check()?;
        let file = plan.scene_name();
        let triangles = inputs.mesh.triangles.len() as u64;
        let file =
            SceneFile { file, sha256: inputs.sha256.clone(), triangles };
        let mesh = &inputs.mesh;
        let once = if built.is_none() { host } else { Host::default() };
        let named = named(plan, &inputs, once);
        // Give each face its albedo
        let faces = match &inputs.albedos[..] {
            [] => {
                let others = plan.surfaces.albedo;
                FaceAlbedos::new(&mesh.marks, &named, others)
                    .map_err(|fault| fault.of_file(&file.file))?
            }
            each => FaceAlbedos::each(each),
        };
        let (asked, table) = asked(plan, &inputs, &faces).unzip();
        let around = (named, inputs.sky.as_ref());
        let mut subject = subject(plan, mesh, around, asked)?;
        note_camera(plan, &subject, host);
        note_panes(&subject.named, host);
        let light = light(plan, mesh, &subject);
        let (seconds, shared) = (inputs.seconds, inputs.mesh.clone());
        let named_mesh = plan.tally.as_ref().map(|tally| (tally, shared));
        // Place the sensor in the frame of the scene
        let is_elsewhere = match plan.sensor {
            SensorPlan::Camera(_) | SensorPlan::Points(_) => true,
            SensorPlan::Faces { .. } | SensorPlan::Vertices => false,
        };
        let scene = match built.filter(|_| is_elsewhere) {
            Some(built) => Scene::empty(built.frame.clone()),
            None => {
                let mesh = Arc::unwrap_or_clone(inputs.mesh);
                Scene::keeping(mesh, |face| {
                    faces.bsdf(face).transmittance()
                })
            }
        };
        let mut sensor = match &table {
            Some(table) => Sensor::Receivers(table.receivers(&scene)),
            None => camera(&subject.sensed, &scene.frame)?,
        };
        let geometry = match built {
            Some(built) => built.clone(),
            None => {
                let rays = rays(plan, &subject, &sensor);
                build(plan, scene, rays, (&subject, &faces), host)?
            }
        };
        let Geometry { frame, bvh, left_out, quality, .. } = &*geometry;
        // Find the columns of a tally
        let columns = named_mesh.map(|(tally, mesh)| {
            let (zenith, has_sides) =
                (subject.sky.zenith, plan.has_sides());
            Columns::new(tally, &mesh, &faces, zenith, has_sides)
        });
        let columns = columns.transpose()?;
        // Sort the receivers and finish the world
        if let (Some(table), Sensor::Receivers(receivers)) =
            (&table, &mut sensor)
        {
            let grid = Grid::around(&receivers.middles());
            let has_sides =
                plan.points().is_some() && left_out[1].is_empty();
            let around = (bvh, frame, subject.sky.zenith, has_sides);
            receivers.order(around, |hit| grid.order(hit));
            let odd = table.odd(receivers, |why, _| why != INSIDE);
            host.warn_all(&table.file, odd);
            let count = receivers.numbers.len();
            check_receivers(plan, table, count, &mut subject)?;
        }
        let settings = Settings {
            hierarchy: Some(quality.to_string()),
            ..Settings::default()
        };
        let report = Report {
            scene: file,
            settings,
            load_seconds: seconds,
            light,
            ..Report::default()
        };
        let mut world = Self {
            subject,
            sensor,
            geometry,
            analysis: SceneAnalysis::default(),
            table,
            columns,
            report,
        };
        world.analyse(plan, host);
        world.report.build_seconds = began.elapsed().as_secs_f64();
        Ok(world)
    }

    /// Finds the work that the scene does not need, unless that takes too long.
    fn analyse(&mut self, plan: &Plan, host: Host) {
        let (width, height) = self.subject.sensed.resolution();
        let tiles = f64::from(width) * f64::from(height) / 256.;
        let seconds =
            tiles * TILE_SEARCH / rayon::current_num_threads() as f64;
        let is_long = |time: f64| seconds > 0.05 * time;
        let kept = match plan.budget.time.is_some_and(is_long) {
            _ if !plan.shortcuts => &SHORTCUTS[..],
            true => &["background"],
            false => &[],
        };
        let Geometry { left_out, bvh, .. } = &*self.geometry;
        let analysis =
            SceneAnalysis::find(left_out, bvh, &self.view(), kept);
        let (found, area) = analysis.known_pixels.count();
        let last = analysis.left_out().last();
        if let Some(last) = last.filter(|_| 0 < area && found == area) {
            host.warn(&last.reason);
        }
        self.analysis = analysis;
    }

    /// Shows the scene, whose mesh is given, according to another plan; its
    /// materials stay as they were read.
    ///
    /// # Errors
    /// The plan does not suit the scene; it is shown as before.
    pub fn show(&mut self, plan: &Plan, mesh: &Mesh) -> Result<()> {
        let named_albedos = plan.surfaces.named.clone();
        let transmitting = plan.surfaces.transmitting.clone();
        let old = self.subject.named.clone();
        let named = Named { named_albedos, transmitting, ..old };
        let around = (named, self.subject.sky.patchwork.as_ref());
        let new = subject(plan, mesh, around, None)?;
        let sensor = camera(&new.sensed, &self.geometry.frame)?;
        let geometry = Arc::get_mut(&mut self.geometry)
            .ok_or("another world has this geometry")?;
        let old = &self.subject;
        if (old.albedo, &old.named) != (new.albedo, &new.named) {
            let marks = &mesh.marks;
            let faces = FaceAlbedos::new(marks, &new.named, new.albedo)?;
            geometry.albedos = AlbedoTable::new(&faces, &geometry.bvh)?;
        }
        let zenith = |s: &Subject| s.ground.map(|_| s.sky.zenith);
        if zenith(old) != zenith(&new) {
            geometry.bvh.set_ground(zenith(&new));
        }
        (self.subject, self.sensor) = (new, sensor);
        self.analyse(plan, Host::default());
        Ok(())
    }
}

/// Seconds in which a thread searches a tile for background, about.
const TILE_SEARCH: f64 = 3e-6;

/// Builds the geometry of a scene for so many rays.
fn build(
    plan: &Plan,
    scene: Scene,
    rays: f64,
    (subject, faces): (&Subject, &FaceAlbedos),
    host: Host,
) -> Result<Arc<Geometry>> {
    let Scene { frame, triangles, left_out } = scene;
    let rays = rays / host.ranks.rank_and_size().1 as f64;
    let quality = Quality::expecting(triangles.corners.len(), rays);
    warn_of_size(&triangles, host);
    // Warn of a pane that is left out
    let is_clear = |i: &&u32| faces.bsdf(**i).transmittance() > 0.;
    if let Some(first) = left_out[1].iter().find(is_clear) {
        let (file, first) = (plan.scene_name(), first + 1);
        host.warn(format!(
            "{file}: face {first} is the first pane or sheet with the corners of \
             another face: only the one that lets least light through is kept"
        ));
    }
    let of_faces = Some(Tally::ViewFactors(Surface::Faces));
    if let (true, Some(first)) =
        (plan.tally == of_faces, left_out[1].first())
    {
        let (file, first) = (plan.scene_name(), first + 1);
        host.warn(format!(
            "{file}: face {first} is the first with the corners of another face: \
             its column is empty, and its row contradicts that"
        ));
    }
    let total = Some(triangles.corners.len() as u64);
    host.enter("building the hierarchy", total);
    let placed = |n: usize| (host.listen)(Event::Steps(n as u64));
    let mut bvh = Bvh::of(triangles, quality, plan.isa(), &placed)?;
    bvh.set_ground(subject.ground.map(|_| subject.sky.zenith));
    if let Some(two) = coinciding(&bvh, faces) {
        let (file, [a, b]) = (plan.scene_name(), two.map(|i| i + 1));
        host.warn(format!(
            "{file}: face {a} lets light through and coincides with face \
             {b}: values depend on their order; leave out what is double"
        ));
    }
    let albedos = AlbedoTable::new(faces, &bvh)?;
    Ok(Geometry { frame, bvh, left_out, albedos, quality }.into())
}

/// The first face, from 0, that lets light through and has a triangle whose
/// middle or a place beside a corner another face covers, and that other face.
fn coinciding(bvh: &Bvh, faces: &FaceAlbedos) -> Option<[u32; 2]> {
    let is_clear = |slot| faces.bsdf(bvh.face(slot)).transmittance() > 0.;
    let mut clear = vec![];
    bvh.for_each(|slot, corners| {
        clear.extend(is_clear(slot).then_some((slot, *corners)));
    });
    let found = clear.par_iter().filter_map(|&(slot, [a, b, c])| {
        let direction = (b - a).cross(c - a).normalize_or_zero();
        let other = |point: DVec3| {
            let near = nearness(point);
            let ray = Ray { origin: point - near * direction, direction };
            let hit = bvh.first_hit(&ray, Some(slot))?;
            let is_near = hit.point.distance(point) <= near;
            Some(hit.primitive).filter(|i| is_near && *i < GROUND)
        };
        let middle = (a + b + c) / 3.;
        let corners = [a, b, c].map(|corner| corner.lerp(middle, 0.01));
        let other = iter::once(middle).chain(corners).find_map(other);
        Some([slot, other?].map(|slot| bvh.face(slot)))
    });
    found.min()
}

/// The albedos that have names; warns of materials that are ignored.
fn named(plan: &Plan, inputs: &Inputs, host: Host) -> Named {
    let surfaces = &plan.surfaces;
    let materials = inputs.materials.clone();
    let (named_albedos, band) = (surfaces.named.clone(), surfaces.band);
    let ignored = names(&inputs.mesh.marks, MarkKind::Material).count();
    let is_read = surfaces.materials == Some(true) || !materials.is_empty();
    let is_given = is_read || !inputs.albedos.is_empty();
    if ignored > 0 && !is_given && named_albedos.is_empty() {
        let (file, albedo) = (plan.scene_name(), surfaces.albedo);
        host.warn(format!(
            "{file}: its materials are ignored, {ignored} of them: every \
             surface has the albedo {albedo} (--materials)"
        ));
    }
    let panes = inputs.panes.clone();
    let transmitting = surfaces.transmitting.clone();
    Named { named_albedos, band, materials, panes, transmitting }
}

/// The receivers of a plan, if it has any, and their table.
fn asked(
    plan: &Plan,
    inputs: &Inputs,
    albedos: &FaceAlbedos,
) -> Option<(ReceiverSource, Table)> {
    let (mut mesh, mut albedo_of) = (inputs.mesh.clone(), None);
    let (mut file, mut backs) = (plan.scene_name(), Side::Front.backs());
    let (asked, shape) = match &plan.sensor {
        SensorPlan::Camera(_) => return None,
        SensorPlan::Points(path) => {
            (file, mesh) = (input_name(path), Arc::default());
            let hash = inputs.points_sha256.clone();
            (
                ReceiverSource::Points(hash),
                Shape::Points(inputs.points.clone()),
            )
        }
        &SensorPlan::Faces { side, radiosity } => {
            backs = side.backs();
            albedo_of = radiosity.then(|| albedos.clone());
            (ReceiverSource::Faces(side), Shape::Faces(mesh.faces()))
        }
        SensorPlan::Vertices => (ReceiverSource::Vertices, Shape::Vertices),
    };
    let grey = |value| level(value, 255) as u8;
    let table =
        Table { shape, backs, mesh, file, albedos: albedo_of, grey };
    Some((asked, table))
}

/// The subject of a plan and a mesh.
fn subject(
    plan: &Plan,
    mesh: &Mesh,
    (named, known): (Named, Option<&Arc<Patchwork>>),
    receivers: Option<ReceiverSource>,
) -> Result<Subject> {
    let mut up = plan.up.unwrap_or(DVec3::Z);
    let zenith = match plan.sky.zenith {
        None => Sky::new(up).zenith,
        Some(zenith) => Sky::with(zenith, Cover::Uniform).zenith,
    };
    if plan.sky.zenith.is_some() && up == DVec3::Z {
        up = zenith;
    }
    let background = plan.camera().and_then(|camera| camera.background);
    let known = known.filter(|known| known.typed == plan.sky.cover);
    let patchwork = match known {
        Some(known) => Some(known.clone()),
        None => read_sky(plan, Host::default())?,
    };
    let sky = sky(&plan.sky, zenith, patchwork.as_deref())?;
    let excess = if plan.tally.is_none() { sky.excess } else { 0. };
    let sky = Sky { background, excess, ..sky };
    let sensed = match (&plan.sensor, receivers) {
        (SensorPlan::Camera(camera), _) => {
            let view = view(camera, up, zenith, mesh);
            let &CameraPlan { resolution, crop, .. } = camera;
            Sensed::Camera(Framing { resolution, crop, view })
        }
        (_, receivers) => {
            let receivers = receivers.unwrap_or(ReceiverSource::Vertices);
            Sensed::Receivers { receivers, count: 0 }
        }
    };
    let (albedo, ground) = (plan.surfaces.albedo, plan.sky.ground);
    let tally = plan.tally.clone();
    Ok(Subject { sensed, albedo, named, sky, ground, tally })
}

/// The sky of a plan around a zenith.
fn sky(
    plan: &SkyPlan,
    zenith: DVec3,
    patchwork: Option<&Patchwork>,
) -> Result<Sky> {
    let mut sky = match patchwork {
        Some(patchwork) => Sky::of(zenith, patchwork),
        None => Sky::with(zenith, plan.cover.clone()),
    };
    if let Some(sun) = plan.sun {
        let toward = sun.direction(zenith);
        let shines = plan.cover.needs_sun() || plan.direct.is_some();
        let is_up = toward.dot(zenith) > 0. || !shines;
        let named = match sun {
            Sun::Toward(vector) => typed(vector),
            Sun::At(azimuth, altitude) => format!("{azimuth},{altitude}"),
        };
        let wanted = "expected a sun above the horizon";
        require(is_up, "sun", named, wanted)?;
        sky = sky.toward(toward);
        let beam = |irradiance| Beam { toward, irradiance };
        sky.beam = plan.direct.map(beam);
    }
    let is_sound = sky.gradation.is_none_or(Gradation::is_sound);
    let wanted = "its formula grows without bound at the horizon, or is \
                  negative in a part of the sky";
    require(is_sound, "sky", &plan.cover, wanted)?;
    let sunlight = |beam: Beam| beam.irradiance * beam.toward.dot(zenith);
    let lit = 1. + sky.beam.map_or(0., sunlight);
    sky.below = plan.ground_glow.unwrap_or(0.) * lit;
    Ok(sky)
}

/// The view of a camera, which may be placed outside the mesh.
fn view(
    camera: &CameraPlan,
    up: DVec3,
    zenith: DVec3,
    mesh: &Mesh,
) -> View {
    let view = camera.view(up);
    let Stand::Outside(from, angles) = camera.stand else { return view };
    let corners = mesh.triangles.iter().flatten();
    let points = corners.map(|&i| &mesh.vertices[i as usize]);
    let from = (from, angles);
    let outside = view.outside(from, zenith, points, camera.aspect());
    outside.unwrap_or(view)
}

/// Notes where a camera stands that was placed automatically.
fn note_camera(plan: &Plan, subject: &Subject, host: Host) {
    let Some(framing) = subject.sensed.camera() else { return };
    if plan.camera().is_none_or(CameraPlan::is_placed) {
        return;
    }
    let View { position, target, up, fov } = framing.view;
    let [p, t, u] = [position, target, up].map(typed);
    let mut options = format!("-p {p} -t {t}");
    if up != DVec3::Z {
        options += &format!(" -u {u}");
    }
    if fov != CameraPlan::default().fov {
        options += &format!(" -F {fov}");
    }
    let zenith = subject.sky.zenith;
    if zenith != Sky::new(up).zenith {
        options += &format!(" --zenith {}", direction(zenith));
    }
    let note = format!("the camera stands outside: {options}");
    (host.listen)(Event::Note(note));
}

/// Notes how much light panes reflect, which is left out.
fn note_panes(named: &Named, host: Host) {
    let found = named.panes.iter().map(|(n, t)| (&n[..], Bsdf::Glass(*t)));
    let mut panes = BTreeMap::new();
    for (name, bsdf) in found.chain(named.given()) {
        match bsdf {
            Bsdf::Glass(part) => panes.insert(name, part),
            _ => panes.remove(name),
        };
    }
    let Some((name, &part)) = panes.first_key_value() else { return };
    let [through, back] = Pane::new(part).diffuse_shares();
    let (name, part) = (quoted(name), brief(part));
    let more = match panes.len() - 1 {
        0 => String::new(),
        n => format!("; and {n} more"),
    };
    (host.listen)(Event::Note(format!(
        "glass {name} transmits {part} of straight and {through:.3} of diffuse \
         light; the {back:.3} that it reflects of that is left out{more}"
    )));
}

/// A number with six decimals at most.
fn brief(x: f64) -> f64 {
    (1e6 * x).round() / 1e6 + 0.
}

/// The sky and the ground in words, and another axis that seems to be up.
fn light(plan: &Plan, mesh: &Mesh, subject: &Subject) -> String {
    let Sky { zenith, gradation, beam, .. } = subject.sky;
    let cover = &plan.sky.cover;
    let shown = |v: DVec3| direction(v.to_array().map(brief).into());
    let mut light = format!("{cover}, zenith {}", shown(zenith));
    let sun = gradation.filter(|_| cover.needs_sun()).map(|it| it.sun);
    if let Some(sun) = beam.map(|beam| beam.toward).or(sun) {
        light += &format!(", sun {}", shown(sun));
    }
    if let Some(Beam { irradiance, .. }) = beam {
        light += &format!(" of irradiance {}", brief(irradiance));
    }
    let ground = subject.ground.map(|albedo| ("", albedo));
    let glow = plan.sky.ground_glow.filter(|albedo| *albedo > 0.);
    if let Some((kind, albedo)) =
        ground.or(glow.map(|albedo| ("glowing ", albedo)))
    {
        light += &format!(", above a {kind}ground of albedo {albedo}");
    }
    let seems_up = if plan.says_up() { None } else { mesh.up() };
    if let Some(up) = seems_up.filter(|&up| up != zenith) {
        let up = direction(up);
        light += &format!("; but {up} looks up: -u {up}");
    }
    light
}

/// Warns of triangles that are too small.
fn warn_of_size(triangles: &crate::scene::Triangles, host: Host) {
    let (count, total) = (too_small(triangles), triangles.corners.len());
    if count > 0 {
        host.warn(format!(
            "{count} of {total} triangles: smaller than 2^-40 of the largest, \
             or 2^-43 of the scene; close to larger ones the light may be wrong"
        ));
    }
}

/// The camera of a subject.
fn camera(sensed: &Sensed, frame: &Frame) -> Result<Sensor> {
    let framing = sensed.camera().ok_or("there is no camera")?;
    let (width, height) = framing.resolution;
    let aspect = f64::from(width) / f64::from(height);
    let camera = Camera::new(&framing.view, aspect)?;
    let entrance = frame.entrance(camera.position);
    Ok(Sensor::Camera(camera, entrance))
}

/// An estimate of the rays of a run.
fn rays(plan: &Plan, subject: &Subject, sensor: &Sensor) -> f64 {
    let area = match sensor {
        Sensor::Camera(..) => {
            let band = plan.part.map_or((1, 1), |part| part.band);
            subject.sensed.window().band(band, SIDE).area()
        }
        Sensor::Receivers(receivers) => receivers.numbers.len(),
    };
    let part = plan.part.map(|part| part.count());
    let samples = part.or(plan.budget.samples);
    let budget = Budget { samples, ..plan.budget };
    expected_rays(&budget, plan.surfaces.albedo, area, sensor)
}

/// Stores the number of receivers, which must suffice for the bands.
fn check_receivers(
    plan: &Plan,
    table: &Table,
    count: usize,
    subject: &mut Subject,
) -> Result<()> {
    let name = table.shape.name();
    if count == 0 {
        return Err(format!("none of the {name} has a value").into());
    }
    if let Sensed::Receivers { count: of, .. } = &mut subject.sensed {
        *of = count as u32;
    }
    let rows = subject.sensed.window().tile_rows(tile_height(true));
    let (k, n) = plan.part.map_or((1, 1), |part| part.band);
    let reason =
        format!("not more bands than there are tiles of {name}: {rows}");
    require(n <= rows, "band", format!("{k}/{n}"), &reason)
}
