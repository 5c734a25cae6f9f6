"""Small stages to mutate: together they use everything that is read from a stage, and each traces in no time."""

from __future__ import annotations

from pathlib import Path

from usd_scenes.hostile.rich_stages import RICH

SCENES = Path(__file__).resolve().parents[1]

_HEAD = """#usda 1.0
(
    defaultPrim = "World"
    startTimeCode = 1
    endTimeCode = 3
    timeCodesPerSecond = 24
    framesPerSecond = 24
    upAxis = "Z"
    metersPerUnit = 1
{more})

"""

_FLOOR = """
    def Mesh "Floor" (
        prepend apiSchemas = ["MaterialBindingAPI"]
    )
    {
        int[] faceVertexCounts = [4]
        int[] faceVertexIndices = [0, 1, 2, 3]
        point3f[] points = [(-2, -2, 0), (2, -2, 0), (2, 2, 0), (-2, 2, 0)]
        color3f[] primvars:displayColor = [(0.8, 0.7, 0.6)] (
            interpolation = "constant"
        )
        uniform token subdivisionScheme = "none"
    }
"""

_SUN = """
    def DistantLight "Sun"
    {
        float inputs:angle = 0
        float inputs:intensity = 2
        color3f inputs:color = (1, 0.9, 0.8)
        float3 xformOp:rotateXYZ = (10, 5, 0)
        uniform token[] xformOpOrder = ["xformOp:rotateXYZ"]
    }
"""

_CAMERA = """
    def Camera "Camera"
    {
        token projection = "perspective"
        float focalLength = 40
        float horizontalAperture = 24
        float verticalAperture = 16
        float2 clippingRange = (0.1, 100)
        double shutter:open = -0.25
        double shutter:close = 0.25
        float exposure = 0
        double3 xformOp:translate.timeSamples = {
            1: (0, 0, 6),
            3: (0.1, 0, 6),
        }
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
"""

_GLASS = """
    def Material "Glass"
    {
        token outputs:surface.connect = </World/Glass/Shader.outputs:surface>

        def Shader "Shader"
        {
            uniform token info:id = "UsdPreviewSurface"
            float inputs:opacity = 0
            float inputs:ior = 1.5
            float inputs:roughness = 0
            token outputs:surface
        }
    }
"""

_WATER = (
    _HEAD.format(more='    renderSettingsPrimPath = "/Render/Settings"\n')
    + """def Xform "World" (
    prepend apiSchemas = ["MotionAPI"]
)
{
    double3 xformOp:translate = (0, 0, 0.1)
    float3 xformOp:rotateXYZ.timeSamples = {
        1: (0, 0, 0),
        2: (0, 0, 5),
        3: (0, 0, 11),
    }
    float3 xformOp:scale = (1, 1, 1)
    uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateXYZ", "xformOp:scale"]
    float motion:blurScale = 1
    token visibility = "inherited"

    def Mesh "Water" (
        prepend apiSchemas = ["MaterialBindingAPI"]
    )
    {
        uniform bool doubleSided = 1
        uniform token orientation = "rightHanded"
        int[] faceVertexCounts = [4, 4, 3]
        int[] faceVertexIndices = [0, 1, 4, 3, 1, 2, 5, 4, 3, 4, 6]
        int[] holeIndices = []
        point3f[] points.timeSamples = {
            1: [(-1, -1, 1), (0, -1, 1.1), (1, -1, 1), (-1, 0, 1), (0, 0, 1), (1, 0, 1.1), (0, 1, 1)],
            2: [(-1, -1, 1.1), (0, -1, 1), (1, -1, 1), (-1, 0, 1), (0, 0, 1.1), (1, 0, 1), (0, 1, 1)],
            3: [(-1, -1, 1), (0, -1, 1), (1, -1, 1.1), (-1, 0, 1.1), (0, 0, 1), (1, 0, 1), (0, 1, 1)],
        }
        normal3f[] normals.timeSamples = {
            1: [(0, 0, 1), (0, 0.1, 1), (0, 0, 1), (0, 0, 1), (0, 0, 1), (0, 0, 1), (0, 0, 1)],
            2: [(0.1, 0, 1), (0, 0, 1), (0, 0, 1), (0, 0, 1), (0, 0, 1), (0, 0, 1), (0, 0, 1)],
            3: [(0, 0, 1), (0, 0, 1), (0, 0, 1), (0, -0.1, 1), (0, 0, 1), (0, 0, 1), (0, 0, 1)],
        }
        vector3f[] velocities.timeSamples = {
            1: [(0, 0, 1), (0, 0, -1), (0, 0, 0), (0, 0, 0), (0, 0, 1), (0, 0, -1), (0, 0, 0)],
            2: [(0, 0, 0), (0, 0, 0), (0, 0, 1), (0, 0, 1), (0, 0, 0), (0, 0, -1), (0, 0, 0)],
            3: [(0, 0, 0), (0, 0, 0), (0, 0, 1), (0, 0, 1), (0, 0, 0), (0, 0, -1), (0, 0, 0)],
        }
        uniform token subdivisionScheme = "none"
        rel material:binding = </World/Glass>
    }
"""
    + _FLOOR
    + _SUN
    + _CAMERA
    + _GLASS
    + """}

def Scope "Render"
{
    def RenderSettings "Settings"
    {
        rel camera = </World/Camera>
        rel products = </Render/Product>
        int2 resolution = (18, 12)
        float pixelAspectRatio = 1
        uniform token aspectRatioConformPolicy = "expandAperture"
        uniform token[] includedPurposes = ["default", "render"]
        bool disableMotionBlur = 0
    }

    def RenderProduct "Product"
    {
        rel camera = </World/Camera>
        float4 dataWindowNDC = (0, 0, 1, 1)
    }
}
"""
)

_INSTANCES = (
    _HEAD.format(more="")
    + """def Xform "World"
{
    def PointInstancer "Drops"
    {
        rel prototypes = [</World/Drops/Ball>, </World/Drops/Chip>]
        int[] protoIndices = [0, 1, 0]
        point3f[] positions.timeSamples = {
            1: [(-1, 0, 1), (0, 0, 1.2), (1, 0, 1)],
            3: [(-1, 0.2, 1), (0, 0.1, 1.2), (1, 0, 1.1)],
        }
        quath[] orientations = [(1, 0, 0, 0), (0.7, 0.7, 0, 0), (1, 0, 0, 0)]
        float3[] scales = [(1, 1, 1), (0.5, 0.5, 0.5), (1, 1, -1)]
        vector3f[] velocities = [(0, 2, 0), (0, 1, 0), (0, 0, 1)]
        vector3f[] angularVelocities = [(0, 0, 90), (0, 0, 0), (0, 0, 0)]
        int64[] invisibleIds = []
        int64[] ids = [5, 6, 7]

        def Mesh "Ball" (
            prepend apiSchemas = ["MaterialBindingAPI"]
        )
        {
            int[] faceVertexCounts = [3, 3, 3, 3]
            int[] faceVertexIndices = [0, 2, 1, 0, 1, 3, 1, 2, 3, 2, 0, 3]
            point3f[] points = [(-0.4, -0.3, -0.2), (0.4, -0.3, -0.2), (0, 0.4, -0.2), (0, 0, 0.4)]
            uniform token subdivisionScheme = "none"
            rel material:binding = </World/Glass>
        }

        def Xform "Chip"
        {
            matrix4d xformOp:transform = ( (1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0.1, 1) )
            uniform token[] xformOpOrder = ["xformOp:transform"]

            def Mesh "Plate" (
                prepend apiSchemas = ["MaterialBindingAPI"]
            )
            {
                int[] faceVertexCounts = [4]
                int[] faceVertexIndices = [0, 1, 2, 3]
                point3f[] points = [(-0.5, -0.5, 0), (0.5, -0.5, 0), (0.5, 0.5, 0), (-0.5, 0.5, 0)]
                rel material:binding = </World/Mirror>
            }
        }
    }

    def Xform "Prototype"
    {
        def Mesh "Tile" (
            prepend apiSchemas = ["MaterialBindingAPI"]
        )
        {
            int[] faceVertexCounts = [4]
            int[] faceVertexIndices = [0, 1, 2, 3]
            point3f[] points = [(-0.3, -0.3, 2), (0.3, -0.3, 2), (0.3, 0.3, 2), (-0.3, 0.3, 2)]
            normal3f[] primvars:normals = [(0, 0, 1), (0, 0.1, 1)] (
                interpolation = "vertex"
            )
            int[] primvars:normals:indices = [0, 1, 1, 0]
            uniform token subdivisionScheme = "none"
            rel material:binding = </World/Glass>
        }
    }

    def "Left" (
        instanceable = true
        prepend references = </World/Prototype>
    )
    {
        double3 xformOp:translate.timeSamples = {
            1: (-1, 1, 0),
            3: (-1, 1, 0.3),
        }
        float xformOp:rotateX:tilt = 10
        uniform token[] xformOpOrder = ["!resetXformStack!", "xformOp:translate", "xformOp:rotateX:tilt"]
    }

    def "Right" (
        instanceable = true
        prepend references = </World/Prototype>
    )
    {
        quatf xformOp:orient.timeSamples = {
            1: (1, 0, 0, 0),
            3: (0.9, 0.1, 0, 0),
        }
        double3 xformOp:translate:pivot = (1, 1, 0)
        uniform token[] xformOpOrder = ["xformOp:translate:pivot", "xformOp:orient", "!invert!xformOp:translate:pivot"]
    }
"""
    + _FLOOR
    + """
    def SphereLight "Lamp"
    {
        float inputs:radius = 0.1
        bool treatAsPoint = 1
        float inputs:intensity.timeSamples = {
            1: 10,
            3: 20,
        }
        float inputs:exposure = 1
        float inputs:diffuse = 1
        bool inputs:normalize = 0
        bool inputs:enableColorTemperature = 1
        float inputs:colorTemperature = 5000
        double3 xformOp:translate.timeSamples = {
            1: (0, 0, 4),
            3: (0.3, 0, 4),
        }
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
"""
    + _CAMERA
    + _GLASS
    + """
    def Material "Mirror"
    {
        color3f inputs:tint = (0.9, 0.8, 0.7)
        token outputs:surface.connect = </World/Mirror/Shader.outputs:surface>

        def Shader "Shader"
        {
            uniform token info:id = "UsdPreviewSurface"
            color3f inputs:diffuseColor.connect = </World/Mirror.inputs:tint>
            float inputs:metallic = 1
            float inputs:roughness = 0
            token outputs:surface
        }
    }
}
"""
)

_CHANGING = (
    _HEAD.format(more="")
    + """def Xform "World"
{
    def Mesh "Splash" (
        prepend apiSchemas = ["MaterialBindingAPI"]
    )
    {
        int[] faceVertexCounts.timeSamples = {
            1: [4],
            2: [3, 3],
            3: [3],
        }
        int[] faceVertexIndices.timeSamples = {
            1: [0, 1, 2, 3],
            2: [0, 1, 2, 0, 2, 3],
            3: [0, 1, 2],
        }
        point3f[] points.timeSamples = {
            1: [(-1, -1, 1), (1, -1, 1), (1, 1, 1.2), (-1, 1, 1)],
            2: [(-1, -1, 1), (1, -1, 1.1), (1, 1, 1.2), (-1, 1, 1)],
            3: [(-1, -1, 1), (1, -1, 1), (1, 1, 1.2)],
        }
        vector3f[] velocities.timeSamples = {
            1: [(0, 0, 1), (0, 0, 1), (0, 0, 2), (0, 0, 0)],
            2: [(0, 0, 1), (0, 0, 1), (0, 0, 2), (0, 0, 0)],
            3: [(0, 0, 1), (0, 0, 1), (0, 0, 2)],
        }
        vector3f[] accelerations.timeSamples = {
            1: [(0, 0, 1), (0, 0, 1), (0, 0, 2), (0, 0, 0)],
        }
        color3f[] primvars:displayColor = [(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1)] (
            interpolation = "vertex"
        )
        uniform token subdivisionScheme = "none"
        uniform token subsetFamily:materialBind:familyType = "nonOverlapping"
        token visibility.timeSamples = {
            1: "inherited",
            2: "inherited",
            3: "invisible",
        }
        rel material:binding = </World/Glass>

        def GeomSubset "Part" (
            prepend apiSchemas = ["MaterialBindingAPI"]
        )
        {
            uniform token elementType = "face"
            uniform token familyName = "materialBind"
            int[] indices = [0]
            rel material:binding = </World/Open>
        }
    }

    def Mesh "Bowl" (
        prepend apiSchemas = ["MaterialBindingAPI"]
    )
    {
        int[] faceVertexCounts = [4, 4]
        int[] faceVertexIndices = [0, 1, 2, 3, 1, 4, 5, 2]
        point3f[] points = [(-1, -1, 0.5), (0, -1, 0.4), (0, 1, 0.4), (-1, 1, 0.5), (1, -1, 0.5), (1, 1, 0.5)]
        uniform token subdivisionScheme = "catmullClark"
        uniform token purpose = "render"
        color3f[] primvars:displayColor = [(0.5, 0.5, 0.5), (0.2, 0.3, 0.4)] (
            interpolation = "uniform"
        )
        rel material:binding = </World/Textured>
    }
"""
    + _FLOOR
    + _SUN
    + """
    def SphereLight "Bulb"
    {
        float inputs:radius = 0
        float inputs:intensity = 5
        double3 xformOp:translate = (0.5, 0.3, 3)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }

    def RectLight "Panel"
    {
    }
"""
    + _CAMERA.replace("perspective", "orthographic")
    + _GLASS
    + """
    def Material "Open"
    {
        token outputs:mtlx:surface.connect = </World/Open/Surface.outputs:out>

        def Shader "Surface"
        {
            uniform token info:id = "ND_open_pbr_surface_surfaceshader"
            color3f inputs:base_color = (0.8, 0.8, 0.8)
            float inputs:base_weight = 1
            float inputs:transmission_weight = 1
            float inputs:specular_ior = 1.4
            float inputs:specular_roughness = 0
            token outputs:out
        }
    }

    def Material "Textured"
    {
        token outputs:surface.connect = </World/Textured/Surface.outputs:surface>

        def Shader "Surface"
        {
            uniform token info:id = "UsdPreviewSurface"
            color3f inputs:diffuseColor.connect = </World/Textured/Texture.outputs:rgb>
            float inputs:clearcoat = 0.5
            token outputs:surface
        }

        def Shader "Texture"
        {
            uniform token info:id = "UsdUVTexture"
            asset inputs:file = @no_such.png@
            float4 inputs:fallback = (0.2, 0.3, 0.4, 1)
            float3 outputs:rgb
        }
    }
}
"""
)

HANDMADE = {"water": _WATER, "instances": _INSTANCES, "changing": _CHANGING, **RICH}
SHIPPED = ("cylinder", "mirror", "wave", "sea")
