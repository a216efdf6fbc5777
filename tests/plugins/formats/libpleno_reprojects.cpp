// How far libpleno's own functions project what an export of ours observes from there: a line each, u, v and rho.
#include <cstdio>
#include "geometry/reprojection.h"
#include "io/cfg/observations.h"
#include "io/cfg/poses.h"

int main(int, char** argv) {
    const std::string folder = argv[1];
    ObservationsConfig seen;
    CalibrationPosesConfig poses;
    SceneConfig scene;
    PlenopticCamera camera;
    v::load(folder + "/observations.bin.gz", seen);
    v::load(folder + "/poses.js", poses);
    v::load(folder + "/scene.js", scene);
    load(folder + "/intrinsics.js", camera);
    v::load(folder + "/params.js", v::make_serializable(&camera.params()));
    camera.mi2ml(seen.features());
    camera.mi2ml(seen.centers());
    const CheckerBoard board{scene.checkerboards()[0]};
    for (const auto& one : seen.features())
        for (const auto& posed : poses.poses())
            if (posed.frame() == one.frame) {
                const P3D off = reproject_bapfeature(camera, posed.pose(), board, one);
                std::printf("%.17g %.17g %.17g\n", off[0] - one.u, off[1] - one.v, off[2] - one.rho);
            }
    for (const auto& one : seen.centers()) {
        const P2D off = reproject_miccenter(camera, one);
        std::printf("%.17g %.17g 0\n", off[0] - one.u, off[1] - one.v);
    }
}
