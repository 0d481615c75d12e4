// Times CGAL's Surface_mesh_deformation on one edit, and hands back positions. Compiled by editing_peers.py, where CGAL is installed.
//
//   cgal_deformation EDIT POSITIONS
//
// EDIT holds 64-bit numbers: algorithm (0 original, 1 spokes and rims, 2 smoothed rotations), iterations per frame, and the counts of
// vertices, faces, region, handle, more handle, frames, kept frames; then the smoothing, positions, faces, the lists of
// vertices, the handle's targets frame by frame, and the kept frames (ascending). POSITIONS receives all vertices after each kept frame.
// Standard output: JSON with wall and CPU seconds of the set-up, of each frame, and of the set-up renewed for the larger handle.
#include <CGAL/Simple_cartesian.h>
#include <CGAL/Surface_mesh.h>
#include <CGAL/Surface_mesh_deformation.h>

#include <cstdint>
#include <cstdio>
#include <ctime>
#include <fstream>
#include <iostream>
#include <vector>

using Kernel = CGAL::Simple_cartesian<double>;
using Surface = CGAL::Surface_mesh<Kernel::Point_3>;
using Vertex = Surface::Vertex_index;

struct Edit {
  std::int64_t algorithm, iterations;
  double smoothing;
  std::vector<std::int64_t> region, handle, more, kept;
  std::vector<double> targets;
  Surface mesh;
};

struct Clock {
  double wall = seconds(CLOCK_MONOTONIC), cpu = seconds(CLOCK_PROCESS_CPUTIME_ID);
  static double seconds(clockid_t which) {
    timespec now;
    clock_gettime(which, &now);
    return now.tv_sec + 1e-9 * now.tv_nsec;
  }
  void tell() const { std::printf("[%.9f, %.9f]", seconds(CLOCK_MONOTONIC) - wall, seconds(CLOCK_PROCESS_CPUTIME_ID) - cpu); }
};

template <class T> std::vector<T> take(std::istream& in, std::size_t count) {
  std::vector<T> values(count);
  in.read(reinterpret_cast<char*>(values.data()), static_cast<std::streamsize>(count * sizeof(T)));
  return values;
}

bool read(const char* path, Edit& edit) {
  std::ifstream in(path, std::ios::binary);
  const auto head = take<std::int64_t>(in, 9);
  edit.algorithm = head[0];
  edit.iterations = head[1];
  edit.smoothing = take<double>(in, 1)[0];
  const auto points = take<double>(in, 3 * head[2]);
  for (std::int64_t i = 0; i < head[2]; ++i) edit.mesh.add_vertex({points[3 * i], points[3 * i + 1], points[3 * i + 2]});
  const auto faces = take<std::int64_t>(in, 3 * head[3]);
  for (std::int64_t f = 0; f < head[3]; ++f)
    if (edit.mesh.add_face(Vertex(faces[3 * f]), Vertex(faces[3 * f + 1]), Vertex(faces[3 * f + 2])) == Surface::null_face()) return false;
  edit.region = take<std::int64_t>(in, head[4]);
  edit.handle = take<std::int64_t>(in, head[5]);
  edit.more = take<std::int64_t>(in, head[6]);
  edit.targets = take<double>(in, 3 * head[5] * head[7]);
  edit.kept = take<std::int64_t>(in, head[8]);
  return static_cast<bool>(in);
}

template <CGAL::Deformation_algorithm_tag algorithm> int run(Edit& edit, const char* path) {
  using Deformation = CGAL::Surface_mesh_deformation<Surface, CGAL::Default, CGAL::Default, algorithm>;
  const Clock start;
  Deformation deformation(edit.mesh);
  for (auto i : edit.region) deformation.insert_roi_vertex(Vertex(i));
  for (auto i : edit.handle) deformation.insert_control_vertex(Vertex(i));
  if (algorithm == CGAL::SRE_ARAP) deformation.set_sre_arap_alpha(edit.smoothing);
  if (!deformation.preprocess()) return 1;
  std::printf("{\"setup\": ");
  start.tell();
  std::printf(", \"frames\": [");
  std::ofstream out(path, std::ios::binary);
  const std::size_t handle = edit.handle.size(), frames = edit.targets.size() / (3 * handle);
  for (std::size_t frame = 0, next = 0; frame < frames; ++frame) {
    const double* target = edit.targets.data() + 3 * handle * frame;
    const Clock begin;
    for (std::size_t k = 0; k < handle; ++k)
      deformation.set_target_position(Vertex(edit.handle[k]), {target[3 * k], target[3 * k + 1], target[3 * k + 2]});
    deformation.deform(static_cast<unsigned int>(edit.iterations), 0.0);
    if (frame) std::printf(", ");
    begin.tell();
    if (next < edit.kept.size() && static_cast<std::size_t>(edit.kept[next]) == frame) {
      ++next;
      for (auto v : edit.mesh.vertices()) {
        const auto p = edit.mesh.point(v);
        const double x[3] = {p.x(), p.y(), p.z()};
        out.write(reinterpret_cast<const char*>(x), sizeof x);
      }
    }
  }
  std::printf("]");
  if (!edit.more.empty()) {
    const Clock begin;
    for (auto i : edit.more) deformation.insert_control_vertex(Vertex(i));
    if (!deformation.preprocess()) return 1;
    std::printf(", \"more\": ");
    begin.tell();
  }
  std::printf("}\n");
  return 0;
}

int main(int count, char** words) {
  Edit edit;
  if (count != 3 || !read(words[1], edit)) {
    std::cerr << "cannot read the edit, or CGAL does not take its faces\n";
    return 2;
  }
  if (edit.algorithm == 0) return run<CGAL::ORIGINAL_ARAP>(edit, words[2]);
  if (edit.algorithm == 1) return run<CGAL::SPOKES_AND_RIMS>(edit, words[2]);
  return run<CGAL::SRE_ARAP>(edit, words[2]);
}
