// Prints what the LAS reader of the npm package copc finds: records, then a point a line (x y z red green blue).
// node las.js FILE
const { Las } = require('copc')
const bytes = require('fs').readFileSync(process.argv[2])
const get = async (from, to) => new Uint8Array(bytes.subarray(from, to))

async function main() {
  const header = Las.Header.parse(await get(0, 375))
  const at = header.pointDataOffset
  for (const record of await Las.Vlr.walk(get, header)) {
    const text = Buffer.from(await Las.Vlr.fetch(get, record)).toString()
    console.log(`# ${record.description} ${text.replace(/\0/g, '').replace(/\n/g, ' ')}`)
  }
  const data = await get(at, at + header.pointCount * header.pointDataRecordLength)
  const view = Las.View.create(data, header)
  const read = ['X', 'Y', 'Z', 'Red', 'Green', 'Blue'].map(name => view.getter(name))
  const lines = []
  for (let i = 0; i < header.pointCount; i++) lines.push(read.map(of => of(i)).join(' '))
  console.log(lines.join('\n'))
}
main().catch(error => {
  console.error(error.message)
  process.exit(1)
})
