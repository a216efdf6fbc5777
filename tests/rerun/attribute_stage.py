"""A stage for `test_attributes`: an occluder, a target of every kind, a conventional and a plenoptic camera, and one
with a channel that takes part where a case says so.
"""

from stage_text import head

STAGE = (
    head("Scene", end=2)
    + """
def PlenDataset "Scene"
{
    rel plen:cameras = [</Scene/A/Camera>, </Scene/B/Camera>]
    rel plen:occluders = </Scene/Screen>
    rel plen:targets = [
        </Scene/One>,
        </Scene/Two>,
        </Scene/More/Charuco>,
        </Scene/More/Tags>,
        </Scene/More/Circles>,
        </Scene/More/Triangles>,
        </Scene/More/Stars>,
        </Scene/More/Siemens>,
        </Scene/More/Edge>,
        </Scene/More/Lines>,
        </Scene/More/Marked>,
    ]

    def "A" (
        prepend references = @rigs/conventional_100mm.usda@
    )
    {
        over "Lens"
        {
            def PlenLensGroup "Rear"
            {
                uniform token[] plen:surfaces = ["S10", "S11"]
            }
        }

        over "Sensor" (
            prepend apiSchemas = ["PlenSensorResponseAPI"]
        )
        {
            uniform int plen:response:bitDepth = 10
            uniform double plen:response:fullWell = 5000
            uniform double plen:response:gain = 0.2
            uniform double plen:pixelPitch = 0.1
            uniform int2 plen:resolution = (32, 24)
        }
    }

    def "B" (
        prepend references = @rigs/plenoptic_michels_2019.usda@
    )
    {
        over "Sensor"
        {
            uniform double plen:pixelPitch = 0.03
            uniform int2 plen:resolution = (48, 40)
        }
    }

    def "C" (
        prepend references = @rigs/conventional_100mm.usda@
    )
    {
        over "Lens"
        {
            uniform token plen:indexSource = "catalogue"
        }

        over "Sensor"
        {
            uniform double plen:pixelPitch = 0.1
            uniform int2 plen:resolution = (32, 24)

            def PlenChannel "Red"
            {
                uniform int plen:nodes = 2
                uniform double[] plen:response = [0.1, 0.5, 0.2]
                uniform double[] plen:wavelengths = [570, 620, 680]
            }
        }
    }

    def PlenCheckerboard "One"
    {
        uniform int plen:columns = 3
        uniform int plen:rows = 2
        uniform double plen:squareSize = 1.4
        double3 xformOp:translate = (0, 0, -434.4)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }

    def PlenCheckerboard "Two"
    {
        uniform int plen:columns = 3
        uniform int plen:rows = 2
        uniform double plen:squareSize = 1
        double3 xformOp:translate = (9, 0, -500)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }

    def Mesh "Screen" (
        prepend apiSchemas = ["PlenOccluderAPI"]
    )
    {
        int[] faceVertexCounts = [3]
        int[] faceVertexIndices = [0, 1, 2]
        point3f[] points = [(90, 0, 0), (99, 0, 0), (90, 9, 0)]
        uniform token subdivisionScheme = "none"
        double3 xformOp:translate = (0, 0, -400)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }

    def DistantLight "Sun"
    {
        float inputs:intensity = 3
        token visibility = "invisible"
    }

    def Xform "More"
    {
        double3 xformOp:translate = (0, 0, -600)
        uniform token[] xformOpOrder = ["xformOp:translate"]

        def PlenCharuco "Charuco"
        {
            uniform int plen:columns = 3
            uniform double plen:markerSize = 4.5
            uniform int plen:rows = 2
            uniform double plen:squareSize = 6
        }

        def PlenAprilGrid "Tags"
        {
            uniform int plen:columns = 3
            uniform int plen:rows = 2
            uniform double plen:tagSize = 8
        }

        def PlenCircleGrid "Circles"
        {
            uniform int plen:columns = 3
            uniform double plen:diameter = 3
            uniform int plen:rows = 3
            uniform double plen:spacing = 6
        }

        def PlenDeltille "Triangles"
        {
            uniform int plen:columns = 3
            uniform double plen:edgeLength = 6
            uniform int plen:rows = 2
        }

        def PlenStars "Stars"
        {
            uniform int plen:columns = 3
            uniform double plen:diameter = 7
            uniform int plen:rows = 2
            uniform double plen:spacing = 8
        }

        def PlenSiemensStar "Siemens"
        {
            uniform double plen:diameter = 40
            uniform int plen:spokes = 6
        }

        def PlenSlantedEdge "Edge"
        {
            uniform double plen:height = 30
            uniform double plen:width = 40
        }

        def PlenLines "Lines"
        {
            uniform int plen:columns = 3
            uniform double plen:lineWidth = 1
            uniform int plen:rows = 2
            uniform double plen:spacing = 6
        }

        def PlenMeshTarget "Marked"
        {
            rel plen:mesh = </Scene/More/Marked/Mesh>
            uniform double3[] plen:normals = [(0, 0, 1)]
            uniform double3[] plen:points = [(1, 1, 0)]

            def Mesh "Mesh"
            {
                int[] faceVertexCounts = [3]
                int[] faceVertexIndices = [0, 1, 2]
                point3f[] points = [(0, 0, 0), (9, 0, 0), (0, 9, 0)]
                uniform token subdivisionScheme = "none"
            }

            def Mesh "Other"
            {
                int[] faceVertexCounts = [3]
                int[] faceVertexIndices = [0, 1, 2]
                point3f[] points = [(0, 0, 0), (8, 0, 0), (0, 8, 0)]
                uniform token subdivisionScheme = "none"
            }
        }
    }
}
"""
)
