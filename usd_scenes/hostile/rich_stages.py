"""Small stages of what studios add to meshes: skeletons, curves, draw modes, filters, graphs, products, clips."""

from __future__ import annotations

from pathlib import Path

_HERE = Path(__file__).resolve().parent
_TEXTURE = _HERE.parent / "table.tiles.jpg"

_HEAD = """#usda 1.0
(
    defaultPrim = "World"
    startTimeCode = 1
    endTimeCode = 3
    upAxis = "Z"
{more})

"""

_SURROUNDINGS = """
    def Mesh "Floor" (
        prepend apiSchemas = ["MaterialBindingAPI"]
    )
    {
        int[] faceVertexCounts = [4]
        int[] faceVertexIndices = [0, 1, 2, 3]
        point3f[] points = [(-2, -2, 0), (2, -2, 0), (2, 2, 0), (-2, 2, 0)]
        texCoord2f[] primvars:st = [(0, 0), (2, 0), (2, 1), (0, 1)] (
            interpolation = "vertex"
        )
        uniform token subdivisionScheme = "none"
        rel material:binding = </World/Looks/Graph>
    }

    def Camera "Camera"
    {
        float focalLength.timeSamples = {
            1: 35,
            3: 40,
        }
        float fStop = 2
        float focusDistance.timeSamples = {
            1: 5,
            3: 6,
        }
        double shutter:open = -0.25
        double shutter:close = 0.25
        matrix4d xformOp:transform:rig = ( (1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 6, 1) )
        double3 xformOp:translate:pivot = (0.1, 0, 0)
        uniform token[] xformOpOrder = [
            "xformOp:translate:pivot",
            "xformOp:transform:rig",
            "!invert!xformOp:translate:pivot",
        ]
    }
"""

_LOOKS = """
    def Scope "Looks"
    {
        def Material "Glass"
        {
            token outputs:surface.connect = </World/Looks/Glass/Shader.outputs:surface>

            def Shader "Shader"
            {
                uniform token info:id = "UsdPreviewSurface"
                float inputs:opacity = 0
                float inputs:ior = 1.5
                float inputs:roughness = 0.1
                token outputs:surface
            }
        }

        def Material "Copper"
        {
            token outputs:surface.connect = </World/Looks/Copper/Shader.outputs:surface>

            def Shader "Shader"
            {
                uniform token info:id = "UsdPreviewSurface"
                color3f inputs:diffuseColor = (0.9, 0.5, 0.3)
                float inputs:metallic = 1
                float inputs:roughness = 0.4
                token outputs:surface
            }
        }

        def Material "Graph"
        {
            float inputs:scale = 2
            token outputs:mtlx:surface.connect = </World/Looks/Graph/Surface.outputs:out>

            def Shader "Surface"
            {
                uniform token info:id = "ND_standard_surface_surfaceshader"
                color3f inputs:base_color.connect = </World/Looks/Graph/Nodes.outputs:color>
                float inputs:specular_roughness = 0.3
                float inputs:coat = 0.2
                token outputs:out
            }

            def NodeGraph "Nodes"
            {
                float inputs:scale.connect = </World/Looks/Graph.inputs:scale>
                color3f outputs:color.connect = </World/Looks/Graph/Nodes/Mix.outputs:out>

                def Shader "Place"
                {
                    uniform token info:id = "ND_texcoord_vector2"
                    float2 outputs:out
                }

                def Shader "Image"
                {
                    uniform token info:id = "ND_image_color3"
                    asset inputs:file = @TEXTURE@ (
                        colorSpace = "srgb_texture"
                    )
                    float2 inputs:texcoord.connect = </World/Looks/Graph/Nodes/Place.outputs:out>
                    color3f outputs:out
                }

                def Shader "Mix"
                {
                    uniform token info:id = "ND_mix_color3"
                    color3f inputs:fg.connect = </World/Looks/Graph/Nodes/Image.outputs:out>
                    color3f inputs:bg = (0.2, 0.4, 0.6)
                    float inputs:mix.connect = </World/Looks/Graph/Nodes.inputs:scale>
                    color3f outputs:out
                }
            }
        }

        def Material "Card"
        {
            token outputs:surface.connect = </World/Looks/Card/Shader.outputs:surface>

            def Shader "Shader"
            {
                uniform token info:id = "UsdPreviewSurface"
                color3f inputs:diffuseColor.connect = </World/Looks/Card/Texture.outputs:rgb>
                float inputs:opacity.connect = </World/Looks/Card/Texture.outputs:r>
                float inputs:opacityThreshold = 0.4
                normal3f inputs:normal.connect = </World/Looks/Card/Texture.outputs:rgb>
                token outputs:surface
            }

            def Shader "Texture"
            {
                uniform token info:id = "UsdUVTexture"
                asset inputs:file = @TEXTURE@
                token inputs:wrapS = "mirror"
                token inputs:wrapT = "clamp"
                float4 inputs:scale = (1, 0.5, 1, 1)
                float4 inputs:bias = (0, 0.1, 0, 0)
                token inputs:sourceColorSpace = "raw"
                float2 inputs:st.connect = </World/Looks/Card/Turn.outputs:result>
                float outputs:r
                float3 outputs:rgb
            }

            def Shader "Turn"
            {
                uniform token info:id = "UsdTransform2d"
                float2 inputs:in.connect = </World/Looks/Card/Reader.outputs:result>
                float inputs:rotation = 30
                float2 inputs:scale = (2, 2)
                float2 inputs:translation = (0.1, 0)
                float2 outputs:result
            }

            def Shader "Reader"
            {
                uniform token info:id = "UsdPrimvarReader_float2"
                string inputs:varname = "st"
                float2 inputs:fallback = (0, 0)
                float2 outputs:result
            }
        }
    }
}
"""

_SKINNED = (
    _HEAD.format(more="")
    + """def Xform "World"
{
    def SkelRoot "Rig" (
        prepend apiSchemas = ["SkelBindingAPI"]
    )
    {
        rel skel:skeleton = </World/Rig/Bones>
        rel skel:animationSource = </World/Rig/Bones/Walk>

        def Skeleton "Bones"
        {
            uniform token[] joints = ["Hip", "Hip/Knee"]
            uniform matrix4d[] bindTransforms = [
                ( (1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0.5, 1) ),
                ( (1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 1, 1) ),
            ]
            uniform matrix4d[] restTransforms = [
                ( (1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0.5, 1) ),
                ( (1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0.5, 1) ),
            ]

            def SkelAnimation "Walk"
            {
                uniform token[] joints = ["Hip", "Hip/Knee"]
                float3[] translations = [(0, 0, 0.5), (0, 0, 0.5)]
                quatf[] rotations.timeSamples = {
                    1: [(1, 0, 0, 0), (1, 0, 0, 0)],
                    3: [(1, 0, 0, 0), (0.9, 0.3, 0, 0)],
                }
                half3[] scales = [(1, 1, 1), (1, 1, 1)]
                uniform token[] blendShapes = ["Bulge"]
                float[] blendShapeWeights.timeSamples = {
                    1: [0],
                    3: [1],
                }
            }
        }

        def Mesh "Skin" (
            prepend apiSchemas = ["SkelBindingAPI", "MaterialBindingAPI"]
        )
        {
            int[] faceVertexCounts = [4, 4]
            int[] faceVertexIndices = [0, 1, 2, 3, 3, 2, 4, 5]
            point3f[] points = [(-1, -1, 0.6), (1, -1, 0.6), (1, 0, 0.8), (-1, 0, 0.8), (1, 1, 1.2), (-1, 1, 1.2)]
            uniform token subdivisionScheme = "none"
            int[] primvars:skel:jointIndices = [0, 1, 0, 1, 0, 1, 0, 1, 0, 1, 0, 1] (
                elementSize = 2
                interpolation = "vertex"
            )
            float[] primvars:skel:jointWeights = [1, 0, 1, 0, 0.5, 0.5, 0.5, 0.5, 0, 1, 0, 1] (
                elementSize = 2
                interpolation = "vertex"
            )
            matrix4d primvars:skel:geomBindTransform = ( (1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1) )
            uniform token skinningMethod = "classicLinear"
            uniform token[] skel:blendShapes = ["Bulge"]
            rel skel:blendShapeTargets = </World/Rig/Skin/Bulge>
            rel material:binding = </World/Looks/Glass>

            def BlendShape "Bulge"
            {
                uniform vector3f[] offsets = [(0, 0, 0.3), (0, 0, 0.2)]
                uniform int[] pointIndices = [2, 3]
                uniform vector3f[] normalOffsets = []

                uniform vector3f[] inbetweens:half:offsets = [(0, 0, 0.1), (0, 0, 0.1)] (
                    weight = 0.5
                )
            }
        }
    }

    def BasisCurves "Hair" (
        prepend apiSchemas = ["MaterialBindingAPI"]
    )
    {
        int[] curveVertexCounts = [4, 5]
        point3f[] points.timeSamples = {
            1: [(0, 0, 0), (0, 0, 1), (0.5, 0, 1), (0.5, 0, 2), (1, 0, 0), (1, 0, 1), (1, 1, 1), (1, 1, 2), (1, 2, 2)],
            3: [(0, 0, 0), (0, 0, 1), (0.5, 0, 1), (0.7, 0, 2), (1, 0, 0), (1, 0, 1), (1, 1, 1), (1, 1, 2), (1, 2, 2)],
        }
        float[] widths = [0.1, 0.05] (
            interpolation = "uniform"
        )
        uniform token type = "cubic"
        uniform token basis = "bspline"
        uniform token wrap = "pinned"
        rel material:binding = </World/Looks/Copper>
    }

    def Points "Spray"
    {
        point3f[] points = [(-1, 1, 1), (-1.2, 1, 1), (-1, 1.3, 1)]
        vector3f[] velocities = [(0, 0, 24), (0, 0, 0), (24, 0, 0)]
        float[] widths = [0.1, 0.2, 0.1] (
            interpolation = "vertex"
        )
        int64[] ids = [3, 4, 5]
        color3f[] primvars:displayColor = [(1, 0, 0), (0, 1, 0), (0, 0, 1)] (
            interpolation = "vertex"
        )
        float[] primvars:displayOpacity = [0.5, 1, 0] (
            interpolation = "vertex"
        )
    }

    def NurbsPatch "Sheet"
    {
        int uVertexCount = 3
        int vVertexCount = 3
        int uOrder = 3
        int vOrder = 3
        double[] uKnots = [0, 0, 0, 1, 1, 1]
        double[] vKnots = [0, 0, 0, 1, 1, 1]
        double2 uRange = (0, 1)
        double2 vRange = (0, 1)
        point3f[] points = [
            (-1, -2, 1), (0, -2, 1.2), (1, -2, 1), (-1, -1.5, 1), (0, -1.5, 1.3), (1, -1.5, 1), (-1, -1, 1),
            (0, -1, 1.2), (1, -1, 1),
        ]
    }

    def SphereLight "Lamp"
    {
        float inputs:radius = 0.2
        float inputs:intensity = 30
        float3 xformOp:scale = (2, 1, 0.5)
        double3 xformOp:translate = (0, 0, 4)
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:scale"]
    }
"""
    + _SURROUNDINGS
    + _LOOKS
)

_LIT = (
    _HEAD.format(more='    renderSettingsPrimPath = "/Render/Settings"\n')
    + """def Xform "World"
{
    def Capsule "Drop" (
        prepend apiSchemas = ["MaterialBindingAPI"]
    )
    {
        double height = 0.5
        double radius.timeSamples = {
            1: 0.3,
            3: 0.4,
        }
        token axis = "Y"
        double3 xformOp:translate = (0, 0, 1)
        uniform token[] xformOpOrder = ["xformOp:translate"]
        rel material:binding = </World/Looks/Glass>
    }

    def Cone "Hat" (
        prepend apiSchemas = ["MaterialBindingAPI"]
    )
    {
        double height = 0.5
        double radius = 0.3
        double3 xformOp:translate = (1, 0, 0.5)
        uniform token[] xformOpOrder = ["xformOp:translate"]
        rel material:binding = </World/Looks/Copper>
    }

    def Mesh "Glow" (
        prepend apiSchemas = ["MeshLightAPI", "MaterialBindingAPI"]
    )
    {
        int[] faceVertexCounts = [3, 3]
        int[] faceVertexIndices = [0, 2, 1, 1, 2, 3]
        point3f[] points.timeSamples = {
            1: [(-1, -1, 3), (0, -1, 3), (-1, 0, 3), (0, 0, 3.1)],
            3: [(-1, -1, 3), (0, -1, 3), (-1, 0, 3), (0, 0, 3.3)],
        }
        uniform token subdivisionScheme = "none"
        float inputs:intensity = 3
        color3f inputs:color = (1, 0.8, 0.6)
        bool inputs:normalize = 0
        token light:materialSyncMode = "independent"
    }

    def RectLight "Panel" (
        prepend apiSchemas = ["ShapingAPI", "ShadowAPI", "CollectionAPI:lightLink", "CollectionAPI:shadowLink"]
    )
    {
        float inputs:width = 1
        float inputs:height = 0.5
        float inputs:intensity = 10
        float inputs:shaping:cone:angle = 60
        float inputs:shaping:cone:softness = 0.2
        float inputs:shaping:focus = 1
        color3f inputs:shaping:focusTint = (0.1, 0.1, 0.1)
        asset inputs:shaping:ies:file = @no_such.ies@
        asset inputs:texture:file = @TEXTURE@
        bool inputs:shadow:enable = 1
        bool collection:lightLink:includeRoot = 1
        rel collection:lightLink:excludes = </World/Hat>
        uniform token collection:shadowLink:expansionRule = "expandPrims"
        rel collection:shadowLink:includes = [</World/Floor>, </World/Drop>]
        rel light:filters = </World/Barn>
        double3 xformOp:translate = (0, 0, 3)
        float3 xformOp:rotateXYZ = (10, 0, 0)
        double3 xformOp:scale = (1, 2, 1)
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateXYZ", "xformOp:scale"]
    }

    def LightFilter "Barn"
    {
        uniform token lightFilter:shaderId = "PxrIntMultLightFilter"
        float inputs:intensity = 0.5
    }

    def CylinderLight "Tube"
    {
        float inputs:length = 1
        float inputs:radius = 0.1
        bool treatAsLine = 0
        float inputs:intensity = 5
        double3 xformOp:translate = (-1, 1, 2)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }

    def DiskLight "Spot"
    {
        float inputs:radius = 0.2
        float inputs:exposure.timeSamples = {
            1: 1,
            3: 2,
        }
        double3 xformOp:translate = (1, 1, 3)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }

    def DomeLight "Sky"
    {
        asset inputs:texture:file = @TEXTURE@
        token inputs:texture:format = "latlong"
        float inputs:intensity = 0.2
        rel portals = </World/Window>
    }

    def PortalLight "Window"
    {
        float inputs:width = 1
    }

    def DistantLight "Sun"
    {
        float intensity = 2
        float angle = 0.5
    }
"""
    + _SURROUNDINGS
    + _LOOKS
    + """
def Scope "Render"
{
    def RenderSettings "Settings"
    {
        rel camera = </World/Camera>
        rel products = [</Render/Beauty>, </Render/Deep>]
        int2 resolution = (16, 12)
        uniform token[] includedPurposes = ["default", "proxy"]
        uniform token[] materialBindingPurposes = ["full", ""]
    }

    def RenderProduct "Beauty"
    {
        token productName = "beauty"
        token productType = "raster"
        rel orderedVars = [</Render/Color>, </Render/Depth>]
    }

    def RenderProduct "Deep"
    {
        token productName = "deep"
        token productType = "deepRaster"
        int2 resolution = (8, 6)
        float4 dataWindowNDC = (0.25, 0, 1, 1)
        uniform bool disableMotionBlur = 1
        rel orderedVars = </Render/Depth>
    }

    def RenderVar "Color"
    {
        uniform token dataType = "color3f"
        uniform string sourceName = "Ci"
        uniform token sourceType = "raw"
    }

    def RenderVar "Depth"
    {
        uniform token dataType = "float"
        uniform string sourceName = "depth"
        uniform token sourceType = "raw"
    }
}
"""
)

_COMPOSED = (
    _HEAD.format(more="")
    + """def Xform "World" (
    apiSchemas = ["CollectionAPI:shiny", "MaterialBindingAPI"]
)
{
    uniform token collection:shiny:expansionRule = "expandPrims"
    rel collection:shiny:includes = [</World/Set>, </World/Crowd>]
    rel collection:shiny:excludes = </World/Set/Box>
    rel material:binding:collection:shiny = [</World.collection:shiny>, </World/Looks/Glass>] (
        bindMaterialAs = "strongerThanDescendants"
    )
    rel material:binding:preview = </World/Looks/Copper>

    def Xform "Set" (
        apiSchemas = ["GeomModelAPI"]
        kind = "component"
        variants = {
            string detail = "fine"
        }
        prepend variantSets = "detail"
    )
    {
        uniform token model:drawMode = "cards"
        uniform bool model:applyDrawMode = 0
        uniform token model:cardGeometry = "cross"
        asset model:cardTextureXPos = @TEXTURE@
        float3 model:drawModeColor = (0.2, 0.5, 0.2)
        float3[] extentsHint = [(-1, -1, 0), (1, 1, 1)]

        def Cube "Box" (
            apiSchemas = ["MaterialBindingAPI"]
        )
        {
            double size = 0.5
            float3[] extent = [(-0.25, -0.25, -0.25), (0.25, 0.25, 0.25)]
            rel material:binding = </World/Looks/Card>
            token purpose = "proxy"
        }

        def Mesh "Shell"
        {
            int[] faceVertexCounts = [4, 4, 4, 4, 4, 4]
            int[] faceVertexIndices = [0, 1, 3, 2, 2, 3, 5, 4, 4, 5, 7, 6, 6, 7, 1, 0, 1, 7, 5, 3, 6, 0, 2, 4]
            point3f[] points = [
                (-0.5, -0.5, 1.5), (0.5, -0.5, 1.5), (-0.5, 0.5, 1.5), (0.5, 0.5, 1.5), (-0.5, 0.5, 0.5),
                (0.5, 0.5, 0.5), (-0.5, -0.5, 0.5), (0.5, -0.5, 0.5),
            ]
            int[] holeIndices = [3]
            int[] creaseIndices = [0, 1, 3]
            int[] creaseLengths = [3]
            float[] creaseSharpnesses = [2]
            int[] cornerIndices = [5]
            float[] cornerSharpnesses = [10]
            token interpolateBoundary = "edgeAndCorner"
            token faceVaryingLinearInterpolation = "cornersPlus1"
            uniform token subsetFamily:materialBind:familyType = "partition"

            def GeomSubset "Top" (
                apiSchemas = ["MaterialBindingAPI"]
            )
            {
                uniform token elementType = "face"
                uniform token familyName = "materialBind"
                int[] indices = [0]
                rel material:binding = </World/Looks/Copper> (
                    bindMaterialAs = "weakerThanDescendants"
                )
            }
        }

        variantSet "detail" = {
            "coarse" {
                over "Shell"
                {
                    uniform token subdivisionScheme = "none"
                }
            }
            "fine" {
                over "Shell"
                {
                    uniform token subdivisionScheme = "catmullClark"
                }
            }
        }
    }

    def PointInstancer "Crowd"
    {
        rel prototypes = [</World/Crowd/Ball>, </World/Crowd/Inner>]
        int[] protoIndices = [0, 1]
        point3f[] positions = [(1, 1, 0.5), (-1, 1, 0.5)]
        int64[] invisibleIds.timeSamples = {
            1: [],
            2: [1],
        }
        color3f[] primvars:displayColor = [(1, 0, 0), (0, 1, 0)] (
            interpolation = "vertex"
        )

        def Sphere "Ball"
        {
            double radius.timeSamples = {
                1: 0.2,
                3: 0.3,
            }
        }

        def PointInstancer "Inner"
        {
            rel prototypes = </World/Crowd/Inner/Bead>
            int[] protoIndices = [0, 0]
            point3f[] positions.timeSamples = {
                1: [(0, 0, 0), (0.3, 0, 0)],
                3: [(0, 0, 0.1), (0.3, 0, 0)],
            }
            quatf[] orientationsf = [(1, 0, 0, 0), (0.7, 0, 0.7, 0)]
            vector3f[] accelerations = [(0, 0, 1), (0, 0, 0)]

            def Cylinder "Bead"
            {
                double radius = 0.1
                double height = 0.2
                token axis = "X"
            }
        }
    }

    def Mesh "Cached" (
        clips = {
            dictionary default = {
                double2[] active = [(1, 0), (2, 1)]
                asset[] assetPaths = [@CLIP@, @CLIP@]
                asset manifestAssetPath = @CLIP@
                string primPath = "/Cached"
                double2[] times = [(1, 0), (2, 1), (3, 0)]
            }
        }
    )
    {
        int[] faceVertexCounts = [3]
        int[] faceVertexIndices = [0, 1, 2]
        uniform token subdivisionScheme = "none"
        float[] primvars:displayOpacity = [0.4]
    }

    def Volume "Fog"
    {
        rel field:density = </World/Fog/Density>

        def OpenVDBAsset "Density"
        {
            asset filePath = @no_such.vdb@
        }
    }

    def "Offset" (
        references = </World/Crowd/Ball> (offset = 1; scale = -1)
    )
    {
        double3 xformOp:translate = (-1, -1, 0.3)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
"""
    + _SURROUNDINGS
    + _LOOKS
)


def _filled(text: str) -> str:
    return text.replace("@TEXTURE@", f"@{_TEXTURE}@").replace("@CLIP@", f"@{_HERE / 'clip.usda'}@")


RICH = {"skinned": _filled(_SKINNED), "lit": _filled(_LIT), "composed": _filled(_COMPOSED)}
