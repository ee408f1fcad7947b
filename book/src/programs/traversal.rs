// Times the traversal alone: the same rays, those of real paths in their
// order, for our intersector and for Embree 3 (if it can be loaded). Takes the
// options of pt for a scene and its view, and prints a CSV:
//   scene,triangles,contender,threads  what was measured
//   million_rays_per_second,ratio      each chunk's best time; ours by theirs
// Embree answers with a distance in single precision, and our intersector with a
// point and a unit normal in double precision. Both leave out the triangle
// from which a ray starts; for Embree this is a filter.
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use std::error::Error;
use std::ffi::c_void;
use std::fs;
use std::hint::black_box;
use std::ops::Range;
use std::ptr::null_mut;
use std::sync::{Arc, Barrier};
use std::time::Instant;

use glam::DVec3;
use libloading::Library;
use litpt::bvh::{Bvh, Dispatch, Intersector, Isa, Quality};
use litpt::camera::Camera;
use litpt::cli::options::Options;
use litpt::integrator::PathTracer;
use litpt::materials::Surfaces;
use litpt::plan::Plan;
use litpt::scene::{Ray, Scene, read_obj};
use litpt::sky::Sky;
use litpt_book::paths;

use super::Done;

/// The number that stands for no triangle.
const NONE: u32 = u32::MAX;

const RAYS: usize = 2_000_000;
const CHUNK: usize = 20_000;
const ROUNDS: usize = 5;
const THREADS: [usize; 2] = [1, 2];

/// A range of a walk, to be traced by our intersector.
struct Stretch<'a>(&'a [Step]);

impl Dispatch for Stretch<'_> {
    type Output = u64;

    fn with<K: Intersector>(self, intersector: &K) -> u64 {
        let number = |step: &Step| {
            let hit = intersector.first_hit(&step.ray, step.from);
            u64::from(hit.map_or(NONE, |hit| hit.primitive))
        };
        self.0.iter().map(number).sum()
    }
}

pub fn run(arguments: &[String]) -> Done {
    let name = std::iter::once("traversal");
    let words = name.chain(arguments.iter().map(String::as_str));
    let plan = Options::parse(words).and_then(|it| it.plan(None, false));
    let plan = plan.map_err(|error| format!("{error:?}"))?;
    let input = &plan.scene;
    let mesh = read_obj(&fs::read(input)?)?;
    let (scene, triangles) = (Scene::new(&mesh), mesh.triangles.len());
    drop(mesh);
    let intersector = Bvh::with(&scene, Quality::THOROUGH, Isa::best())?;
    let walk = record(&scene, &intersector, &plan)?;
    let mut contenders = vec![Contender {
        name: "litpt",
        trace: Box::new(|range| {
            intersector.dispatch(Stretch(&walk[range]))
        }),
    }];
    // SAFETY: loading Embree runs its initialisers, which have no conditions.
    match unsafe { Library::new("libembree3.so.3") } {
        Ok(library) => {
            contenders.extend(rivals(library, &scene, &walk)?);
        }
        Err(_) => eprintln!(
            "traversal: Embree is left out: libembree3.so.3 was not found \
             (Debian: libembree3-3)"
        ),
    }
    let name = input.file_stem().unwrap_or_default().to_string_lossy();
    let prefix = format!("{name},{triangles}");
    println!(
        "scene,triangles,contender,threads,million_rays_per_second,ratio"
    );
    for threads in THREADS {
        print_rows(&prefix, threads, &contenders);
    }
    Ok(())
}

// ---- the rays of paths

/// A ray, and the hit from which it starts.
struct Step {
    ray: Ray,
    from: Option<u32>,
}

/// The rays of paths through random points of the image, path by path.
fn record<K: Intersector>(
    scene: &Scene,
    intersector: &K,
    plan: &Plan,
) -> Result<Vec<Step>, Box<dyn Error>> {
    let camera = plan.camera().ok_or("name a camera")?;
    let view = camera.view(plan.up.unwrap_or(DVec3::Z));
    let camera = Camera::new(&view, camera.aspect())?;
    let integrator = PathTracer::new(
        Surfaces::of(plan.surfaces.albedo),
        Sky::new(view.up),
    );
    let seed = plan.seed;
    let rays = paths::record(
        &scene.frame.entrance(view.position),
        intersector,
        &camera,
        &integrator,
        seed,
        RAYS,
    )?;
    let step = |(ray, from)| Step { ray, from };
    Ok(rays.into_iter().take(RAYS).map(step).collect())
}

// ---- timing

/// Traces a range of the rays, and returns a sum that depends on them.
type Trace<'a> = Box<dyn Fn(Range<usize>) -> u64 + Sync + 'a>;

struct Contender<'a> {
    name: &'static str,
    trace: Trace<'a>,
}

/// Seconds of one contender: for each thread, for each round, the chunks.
type Seconds = Vec<Vec<Vec<f64>>>;

fn print_rows(prefix: &str, threads: usize, contenders: &[Contender]) {
    let measured = measure(threads, contenders);
    let all: Vec<_> = measured.iter().map(best).collect();
    for (Contender { name, .. }, best) in contenders.iter().zip(&all) {
        let ratio = all[0] / best;
        println!("{prefix},{name},{threads},{best:.2},{ratio:.3}");
    }
}

/// Times all contenders on all rays, in turns of a round, so that each finds
/// its own data in the caches. Each thread has its own part of the chunks, and
/// at any time all are at the same contender.
fn measure(threads: usize, contenders: &[Contender]) -> Vec<Seconds> {
    let part = RAYS / CHUNK / threads;
    let barrier = Barrier::new(threads);
    let work = |thread: usize| {
        let mut seconds = vec![vec![vec![]; ROUNDS]; contenders.len()];
        let turns = 0..contenders.len();
        for (round, turn) in
            (0..ROUNDS).flat_map(|r| turns.clone().map(move |t| (r, t)))
        {
            let i = (turn + round) % contenders.len();
            barrier.wait();
            for chunk in 0..part {
                let start = (thread * part + chunk) * CHUNK;
                let began = Instant::now();
                black_box((contenders[i].trace)(start..start + CHUNK));
                seconds[i][round].push(began.elapsed().as_secs_f64());
            }
        }
        seconds
    };
    let each: Vec<_> = std::thread::scope(|scope| {
        let work = &work;
        let spawn = |thread| scope.spawn(move || work(thread));
        let handles: Vec<_> = (0..threads).map(spawn).collect();
        let join = handles.into_iter().map(|h| h.join());
        join.map(|seconds| seconds.expect("a thread finishes")).collect()
    });
    let of = |i: usize| each.iter().map(|all| all[i].clone()).collect();
    (0..contenders.len()).map(of).collect()
}

/// Million rays per second when each chunk takes the least of its times.
fn best(seconds: &Seconds) -> f64 {
    let least = |rounds: &Vec<Vec<f64>>| {
        let chunks = 0..rounds[0].len();
        let least =
            |c| rounds.iter().map(|r: &Vec<f64>| r[c]).reduce(f64::min);
        chunks.filter_map(least).sum::<f64>()
    };
    let rays = (seconds[0][0].len() * CHUNK) as f64;
    seconds.iter().map(|rounds| rays / least(rounds) * 1e-6).sum()
}

// ---- Embree 3

/// A ray and its hit, as in rtcore_ray.h.
#[repr(C, align(16))]
struct RayHit {
    origin: [f32; 3],
    near: f32,
    direction: [f32; 3],
    time: f32,
    far: f32,
    mask: u32,
    id: u32,
    flags: u32,
    normal: [f32; 3],
    weights: [f32; 2],
    primitive: u32,
    geometry: u32,
    instance: u32,
}

/// RTCIntersectContext, and after it the triangle that the filter rejects.
#[repr(C)]
struct Context {
    flags: u32,
    filter: unsafe extern "C" fn(*const FilterArguments),
    instance: u32,
    from: u32,
}

#[repr(C)]
struct FilterArguments {
    valid: *mut i32,
    user: *mut c_void,
    context: *const Context,
    ray: *mut c_void,
    /// The normal, the weights, and then the primitive.
    hit: *const [u32; 8],
    count: u32,
}

const TRIANGLE: i32 = 0;
const INDEX: i32 = 0;
const VERTEX: i32 = 1;
const UINT3: i32 = 0x5003;
const FLOAT3: i32 = 0x9003;
const HIGH: i32 = 2;
const ROBUST: i32 = 4;
const CONTEXT_FILTER: i32 = 8;

unsafe extern "C" fn reject(arguments: *const FilterArguments) {
    // SAFETY: Embree calls the filter with the context that the ray was
    // given, and, for a single ray, with one valid hit.
    unsafe {
        let a = &*arguments;
        if (*a.hit)[5] == (*a.context).from {
            *a.valid = 0;
        }
    }
}

type Object = *mut c_void;
type Make = unsafe extern "C" fn(Object) -> Object;
type MakeKind = unsafe extern "C" fn(Object, i32) -> Object;
type Set = unsafe extern "C" fn(Object, i32);
type Buffer =
    unsafe extern "C" fn(Object, i32, u32, i32, usize, usize) -> Object;
type Attach = unsafe extern "C" fn(Object, Object) -> u32;
type Act = unsafe extern "C" fn(Object);
type Intersect = unsafe extern "C" fn(Object, *const Context, *mut RayHit);

/// A scene of Embree, never freed, as the process ends with it.
struct Embree {
    scene: Object,
    intersect: Intersect,
}

// SAFETY: Embree's scenes may be intersected by several threads at once
// after they have been committed.
unsafe impl Sync for Embree {}

impl Embree {
    /// Builds a scene of high quality.
    fn new(
        library: &Library,
        scene: &Scene,
        flags: i32,
    ) -> Result<Self, Box<dyn Error>> {
        let triangles = scene.triangles.to_vec();
        let count = triangles.len();
        // SAFETY: the types are those of rtcore.h, the buffers are as long
        // as is said, and nothing is used after it was given away.
        unsafe {
            let device = library.get::<Make>(b"rtcNewDevice")?(null_mut());
            let new = library.get::<Make>(b"rtcNewScene")?(device);
            library.get::<Set>(b"rtcSetSceneBuildQuality")?(new, HIGH);
            library.get::<Set>(b"rtcSetSceneFlags")?(new, flags);
            let geometry = library.get::<MakeKind>(b"rtcNewGeometry")?(
                device, TRIANGLE,
            );
            let buffer =
                library.get::<Buffer>(b"rtcSetNewGeometryBuffer")?;
            let vertices =
                buffer(geometry, VERTEX, 0, FLOAT3, 12, 3 * count);
            let indices = buffer(geometry, INDEX, 0, UINT3, 12, count);
            for (i, triangle) in triangles.iter().enumerate() {
                let corners =
                    triangle.map(|corner| corner.as_vec3().to_array());
                vertices.cast::<[[f32; 3]; 3]>().add(i).write(corners);
                let numbers = [0, 1, 2].map(|k| 3 * i as u32 + k);
                indices.cast::<[u32; 3]>().add(i).write(numbers);
            }
            library.get::<Act>(b"rtcCommitGeometry")?(geometry);
            library.get::<Attach>(b"rtcAttachGeometry")?(new, geometry);
            library.get::<Act>(b"rtcCommitScene")?(new);
            let intersect = *library.get::<Intersect>(b"rtcIntersect1")?;
            Ok(Self { scene: new, intersect })
        }
    }

    /// The first triangle other than that where the ray starts, or `NONE`.
    #[inline(always)]
    fn first_hit(&self, ray: &Rounded) -> u32 {
        let mut query = RayHit {
            origin: ray.origin,
            near: 0.,
            direction: ray.direction,
            time: 0.,
            far: f32::INFINITY,
            mask: !0,
            id: 0,
            flags: 0,
            normal: [0.; 3],
            weights: [0.; 2],
            primitive: NONE,
            geometry: NONE,
            instance: NONE,
        };
        let context = Context {
            flags: 0,
            filter: reject,
            instance: NONE,
            from: ray.from,
        };
        // SAFETY: the scene was committed; ray and context have the layout
        // that Embree expects, and outlive the call.
        unsafe { (self.intersect)(self.scene, &context, &mut query) };
        query.primitive
    }
}

/// A ray in single precision, and the hit from which it starts.
struct Rounded {
    origin: [f32; 3],
    direction: [f32; 3],
    from: u32,
}

/// Embree, fast and robust, on the rays of a walk.
fn rivals<'a>(
    library: Library,
    scene: &Scene,
    walk: &[Step],
) -> Result<Vec<Contender<'a>>, Box<dyn Error>> {
    let library = Box::leak(Box::new(library));
    let fast = Embree::new(library, scene, CONTEXT_FILTER)?;
    let robust = Embree::new(library, scene, CONTEXT_FILTER | ROBUST)?;
    let rays = Arc::new(rounded(walk, &robust));
    let both = [("Embree", fast), ("Embree robust", robust)];
    let contender = |(name, embree): (_, Embree)| {
        let rays = Arc::clone(&rays);
        let number = move |ray: &Rounded| u64::from(embree.first_hit(ray));
        let trace: Trace =
            Box::new(move |range| rays[range].iter().map(&number).sum());
        Contender { name, trace }
    };
    Ok(both.into_iter().map(contender).collect())
}

/// The rays of a walk. An intersector has numbers of its own for the triangles, so
/// that Embree must say again where the ray before has ended.
fn rounded(walk: &[Step], embree: &Embree) -> Vec<Rounded> {
    let mut last = NONE;
    let round = |step: &Step| {
        let from = if step.from.is_some() { last } else { NONE };
        let [origin, direction] = [step.ray.origin, step.ray.direction]
            .map(|v: DVec3| v.as_vec3().to_array());
        let ray = Rounded { origin, direction, from };
        last = embree.first_hit(&ray);
        ray
    };
    walk.iter().map(round).collect()
}
